// Faces under the pointer and near a point, by a tree of boxes that is built when it is first needed.

import * as THREE from "three";
import { MeshBVH } from "three-mesh-bvh";
import { Surface } from "./model";

const SAMPLES = 2000; // faces whose areas tell the usual length of an edge

export class Picker {
  private readonly tree: MeshBVH;
  private readonly spacing: number;

  constructor(private readonly surface: Surface) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(surface.positions, 3));
    geometry.setIndex(new THREE.BufferAttribute(surface.triangles, 1));
    this.tree = new MeshBVH(geometry, { indirect: true }); // leaves the order of the faces alone
    const count = surface.triangles.length / 3;
    const stride = Math.ceil(count / SAMPLES);
    let [area, seen] = [0, 0];
    for (let face = 0; face < count; face += stride, seen++) area += this.triangle(face).getArea();
    this.spacing = Math.sqrt((2 * area) / seen); // about an edge
  }

  triangle(face: number): THREE.Triangle {
    const { positions, triangles } = this.surface;
    const corner = (k: number) => new THREE.Vector3().fromArray(positions, 3 * triangles[3 * face + k]);
    return new THREE.Triangle(corner(0), corner(1), corner(2));
  }

  hit(ray: THREE.Ray): { face: number; point: THREE.Vector3 } | null {
    const found = this.tree.raycastFirst(ray, THREE.DoubleSide);
    return found ? { face: found.faceIndex!, point: found.point } : null;
  }

  // The vertices within a sphere that are connected with a face there: what a brush on that face reaches, and not the other
  // side of a thin wall.
  around(face: number, point: THREE.Vector3, radius: number): number[] {
    const { triangles, positions } = this.surface;
    const sphere = new THREE.Sphere(point, radius);
    const faces: number[] = [];
    this.tree.shapecast({
      intersectsBounds: (box) => sphere.intersectsBox(box),
      intersectsTriangle: (triangle, index) => {
        if (triangle.intersectsSphere(sphere)) faces.push(index);
        return false;
      },
    });
    const facesOf = new Map<number, number[]>();
    const inside = (vertex: number) => new THREE.Vector3().fromArray(positions, 3 * vertex).distanceTo(point) <= radius;
    for (const index of faces) {
      for (const vertex of triangles.subarray(3 * index, 3 * index + 3)) {
        if (!facesOf.has(vertex)) facesOf.set(vertex, []);
        facesOf.get(vertex)!.push(index);
      }
    }
    const [seen, reached, waiting] = [new Set([face]), new Set<number>(), [face]];
    while (waiting.length) {
      const index = waiting.pop()!;
      for (const vertex of triangles.subarray(3 * index, 3 * index + 3)) {
        if (reached.has(vertex) || !inside(vertex)) continue;
        reached.add(vertex);
        for (const next of facesOf.get(vertex) ?? []) {
          if (!seen.has(next)) waiting.push(next);
          seen.add(next);
        }
      }
    }
    return [...reached];
  }

  near(point: THREE.Vector3): { normal: THREE.Vector3; spacing: number } {
    const found = this.tree.closestPointToPoint(point);
    const normal = new THREE.Vector3();
    if (found) this.triangle(found.faceIndex).getNormal(normal);
    return { normal, spacing: this.spacing };
  }
}
