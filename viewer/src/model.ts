// The meshes of a report and the quantities on them, unpacked, in a frame of about unit size around the origin.

import { Completion, PackedField, PackedMesh, PackedScene, Place, unpacked, unpackedTriangles } from "./format";

export interface Surface {
  name: string;
  label: string;
  file: string; // empty for a mesh that is in none
  faces: number; // of the file; fewer are shown of a large one
  positions: Float32Array; // (n, 3)
  triangles: Uint32Array; // (m, 3)
  colors: Uint8Array | null; // (n, 4)
  numbers: Int32Array | null; // (m,) of the faces in the file, where they do not count from 0
  codes: Int32Array; // the positions as they are packed, column by column
}

// The box in which positions are packed.
type Box = Pick<PackedScene, "lower" | "extent" | "levels">;

export interface Field {
  name: string;
  label: string;
  unit: string;
  at: "face" | "vertex";
  signed: boolean;
  against: "input" | "truth" | null; // the other mesh that it needs
  limits: [number, number];
  values: Map<string, Float32Array>; // by the name of the surface; NaN where there is none
  pinned?: Uint8Array; // 1 for vertices that stay, which have a colour of their own
}

export interface Model {
  box: Box;
  surfaces: Surface[];
  fields: Field[];
  places: Place[];
  center: [number, number, number];
  size: number; // what is 1 in the frame, in the unit of the mesh
  radius: number; // of the sphere around all surfaces, in the frame
  view: { from: number[]; target: number[]; reach: [number, number] }; // half of the width and height to be seen
}

// The model of a scene, or of one that completes that of the model `first`, of which it takes what is the same.
export async function modelOf(scene: PackedScene | Completion, first?: Model): Promise<Model> {
  if ("completes" in scene) {
    const surfaces = await surfacesOf(scene.meshes, first!.box, first!.surfaces);
    return { ...first!, surfaces, fields: await fieldsOf(scene.fields) };
  }
  const size = Math.max(...scene.extent) || 1;
  const center = scene.lower.map((low, axis) => low + scene.extent[axis] / 2) as Model["center"];
  const { from, target, reach } = scene.view;
  return {
    box: scene,
    surfaces: await surfacesOf(scene.meshes, scene, []),
    fields: await fieldsOf(scene.fields),
    places: scene.places,
    center,
    size,
    radius: Math.hypot(...scene.extent) / size / 2 || 1,
    view: {
      from,
      target: target.map((value, axis) => (value - center[axis]) / size),
      reach: [reach[0] / size, reach[1] / size],
    },
  };
}

async function surfacesOf(meshes: PackedMesh[], box: Box, known: Surface[]): Promise<Surface[]> {
  const surfaces = [...known];
  for (const mesh of meshes) {
    const like = surfaces.find((surface) => surface.name === mesh.like);
    const codes = await unpacked(mesh.positions);
    if (like) for (let i = 0; i < codes.length; i++) codes[i] += like.codes[i];
    surfaces.push({
      name: mesh.name,
      label: mesh.label,
      file: mesh.file,
      faces: mesh.faces,
      positions: placed(codes, box),
      triangles: like ? like.triangles : await unpackedTriangles(mesh.triangles!),
      colors: await colorsOf(mesh),
      numbers: mesh.numbers && (await unpacked(mesh.numbers)),
      codes,
    });
  }
  return surfaces;
}

function placed(codes: Int32Array, { extent, levels }: Box): Float32Array {
  const size = Math.max(...extent) || 1;
  const count = codes.length / 3;
  const out = new Float32Array(codes.length);
  for (let axis = 0; axis < 3; axis++) {
    const length = extent[axis] / size;
    for (let i = 0; i < count; i++) out[3 * i + axis] = (codes[axis * count + i] / levels - 0.5) * length;
  }
  return out;
}

async function colorsOf(mesh: PackedMesh): Promise<Uint8Array | null> {
  if (!mesh.colors) return null;
  const columns = await unpacked(mesh.colors);
  const count = mesh.colors.shape[0];
  const out = new Uint8Array(4 * count).fill(255);
  for (let i = 0; i < count; i++) for (let c = 0; c < 3; c++) out[4 * i + c] = columns[c * count + i];
  return out;
}

async function fieldsOf(packed: PackedField[]): Promise<Field[]> {
  const fields: Field[] = [];
  for (const { values, of, ...about } of packed) {
    const arrays = await Promise.all(
      values.map(async ({ start, step, codes }) =>
        Float32Array.from(await unpacked(codes), (code) => (code === 0 ? NaN : start + step * (code - 1))),
      ),
    );
    fields.push({ ...about, values: new Map(Object.entries(of).map(([name, row]) => [name, arrays[row]])) });
  }
  return fields;
}

// A quantity on a face; that of the vertices is the mean of its corners.
export function valueAt(field: Field, surface: Surface, face: number): number {
  const values = field.values.get(surface.name);
  if (!values) return NaN;
  if (field.at === "face") return values[face];
  const [a, b, c] = surface.triangles.subarray(3 * face, 3 * face + 3);
  return (values[a] + values[b] + values[c]) / 3;
}
