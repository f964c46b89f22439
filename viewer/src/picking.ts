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

  face(ray: THREE.Ray): number | null {
    return this.tree.raycastFirst(ray, THREE.DoubleSide)?.faceIndex ?? null;
  }

  near(point: THREE.Vector3): { normal: THREE.Vector3; spacing: number } {
    const found = this.tree.closestPointToPoint(point);
    const normal = new THREE.Vector3();
    if (found) this.triangle(found.faceIndex).getNormal(normal);
    return { normal, spacing: this.spacing };
  }
}
