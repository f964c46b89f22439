// What a report holds for the viewer, and how its arrays are unpacked; cascadenorm/reports/packing.py packs them.

export interface Packed {
  shape: number[];
  differences: boolean;
  bytes: number;
  data: string;
}

export interface PackedMesh {
  name: string;
  label: string;
  file: string;
  faces: number;
  like: string | null;
  positions: Packed;
  triangles: Packed | null;
  colors: Packed | null;
  numbers: Packed | null;
}

export interface PackedField {
  name: string;
  label: string;
  unit: string;
  at: "face" | "vertex";
  signed: boolean;
  against: "input" | "truth" | null; // the other mesh that it needs
  limits: [number, number];
  values: { start: number; step: number; codes: Packed }[];
  of: Record<string, number>;
}

export interface Place {
  mesh: string;
  finding: string;
  label: string;
  at: [number, number, number];
  radius: number;
}

export interface PackedScene {
  format: number;
  lower: [number, number, number];
  extent: [number, number, number];
  levels: number;
  view: { from: number[]; target: number[]; reach: [number, number] };
  meshes: PackedMesh[];
  fields: PackedField[];
  places: Place[];
}

// What completes the scene of a mesh to that of the mesh and a result: what both have in common is there already.
export interface Completion {
  format: number;
  completes: true;
  meshes: PackedMesh[];
  fields: PackedField[];
}

async function inflated(text: string): Promise<Uint8Array> {
  const letters = atob(text);
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// The columns of an array, one after another.
export async function unpacked(packed: Packed): Promise<Int32Array> {
  const planes = await inflated(packed.data);
  const rows = packed.shape[0];
  const count = packed.shape.reduce((product, length) => product * length, 1);
  const out = new Int32Array(count);
  for (let i = 0; i < count; i++) {
    let folded = 0;
    for (let byte = 0; byte < packed.bytes; byte++) folded |= planes[byte * count + i] << (8 * byte);
    out[i] = (folded >>> 1) ^ -(folded & 1);
  }
  if (packed.differences) {
    for (let start = 0; start < count; start += rows) {
      for (let i = start + 1; i < start + rows; i++) out[i] += out[i - 1];
    }
  }
  return out;
}

export async function unpackedTriangles(packed: Packed): Promise<Uint32Array> {
  const columns = await unpacked(packed);
  const count = packed.shape[0];
  const out = new Uint32Array(3 * count);
  let first = 0;
  for (let i = 0; i < count; i++) {
    first += columns[i];
    out[3 * i] = first;
    out[3 * i + 1] = first + columns[count + i];
    out[3 * i + 2] = first + columns[2 * count + i];
  }
  return out;
}
