// A surface on the GPU: its textures, and the mesh of three.js that draws it.

import * as THREE from "three";
import { Field, Surface } from "./model";
import { fragmentShader, NOTHING, PIN, vertexShader, WIDTH } from "./shaders";

export type Uniforms = Record<string, THREE.IUniform>;

export class Drawn {
  readonly object: THREE.Mesh<THREE.BufferGeometry, THREE.RawShaderMaterial>;
  private readonly values = new Map<string, { of: Float32Array; texture: THREE.DataTexture }>(); // by field
  private normals: THREE.DataTexture | null = null;

  constructor(
    readonly surface: Surface,
    shared: Uniforms,
  ) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("corner", new THREE.BufferAttribute(surface.triangles, 1));
    geometry.setDrawRange(0, surface.triangles.length);
    const material = new THREE.RawShaderMaterial({
      glslVersion: THREE.GLSL3,
      vertexShader,
      fragmentShader,
      side: THREE.DoubleSide,
      uniforms: {
        ...shared,
        positions: { value: texture(spread(surface.positions), 4) },
        colors: { value: surface.colors && texture(surface.colors, 4) },
        normals: { value: null },
        values: { value: null },
        atFaces: { value: false },
        hasValues: { value: false },
        hasColors: { value: false },
        picked: { value: -1 },
      },
    });
    this.object = new THREE.Mesh(geometry, material);
    this.object.frustumCulled = false;
  }

  get uniforms(): Uniforms {
    return this.object.material.uniforms;
  }

  paint(field: Field | null, vertexColors: boolean): void {
    const values = field?.values.get(this.surface.name);
    this.uniforms.values.value = field && values ? this.held(field, values) : null;
    this.uniforms.hasValues.value = Boolean(values);
    this.uniforms.atFaces.value = field?.at === "face";
    this.uniforms.hasColors.value = vertexColors && this.surface.colors !== null;
  }

  // Take over values of a field that have changed.
  repaint(field: Field): void {
    const held = this.values.get(field.name)?.texture;
    if (!held) return;
    (held.image.data as Float32Array).set(stored(field.values.get(this.surface.name)!, field.pinned));
    held.needsUpdate = true;
  }

  private held(field: Field, values: Float32Array): THREE.DataTexture {
    const known = this.values.get(field.name);
    if (known?.of === values) return known.texture;
    known?.texture.dispose(); // of a result before
    const made = texture(stored(values, field.pinned), 1);
    this.values.set(field.name, { of: values, texture: made });
    return made;
  }

  dispose(): void {
    const { positions, colors } = this.uniforms;
    const values = [...this.values.values()].map(({ texture }) => texture);
    for (const held of [positions.value, colors.value, this.normals, ...values]) held?.dispose();
    this.object.geometry.dispose();
    this.object.material.dispose();
  }

  needsNormals(): void {
    this.normals ??= texture(spread(vertexNormals(this.surface)), 4);
    this.uniforms.normals.value = this.normals;
  }
}

function stored(values: Float32Array, pinned?: Uint8Array): Float32Array {
  return values.map((value, i) => (pinned?.[i] ? PIN : Number.isNaN(value) ? NOTHING : value));
}

function spread(rows: Float32Array): Float32Array {
  const out = new Float32Array((rows.length / 3) * 4);
  for (let i = 0, j = 0; i < rows.length; i += 3, j += 4) {
    out[j] = rows[i];
    out[j + 1] = rows[i + 1];
    out[j + 2] = rows[i + 2];
  }
  return out;
}

function texture(data: Float32Array | Uint8Array, channels: 1 | 4): THREE.DataTexture {
  const height = Math.max(1, Math.ceil(data.length / channels / WIDTH));
  const full = data instanceof Float32Array ? new Float32Array(WIDTH * height * channels) : new Uint8Array(WIDTH * height * channels);
  full.set(data);
  const made = new THREE.DataTexture(
    full,
    WIDTH,
    height,
    channels === 1 ? THREE.RedFormat : THREE.RGBAFormat,
    data instanceof Float32Array ? THREE.FloatType : THREE.UnsignedByteType,
  );
  made.needsUpdate = true;
  return made;
}

// Sums of the area vectors around each vertex; the shader scales them.
function vertexNormals({ positions, triangles }: Surface): Float32Array {
  const out = new Float32Array(positions.length);
  const [u, v, w] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
  for (let i = 0; i < triangles.length; i += 3) {
    const [a, b, c] = [3 * triangles[i], 3 * triangles[i + 1], 3 * triangles[i + 2]];
    u.fromArray(positions, b).sub(w.fromArray(positions, a));
    v.fromArray(positions, c).sub(w);
    u.cross(v);
    for (const vertex of [a, b, c]) {
      out[vertex] += u.x;
      out[vertex + 1] += u.y;
      out[vertex + 2] += u.z;
    }
  }
  for (let i = 0; i < out.length; i += 3) {
    const length = Math.hypot(out[i], out[i + 1], out[i + 2]) || 1;
    for (let axis = 0; axis < 3; axis++) out[i + axis] /= length;
  }
  return out;
}
