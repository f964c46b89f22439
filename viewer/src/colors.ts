// The colours that pictures and the viewer share, from the table of cascadenorm.render.

import table from "../../cascadenorm/render/colors.json";

export type Color = [number, number, number]; // sRGB, 0 to 255

export const STEPS = 256;
export const [CLAY, INSIDE, UNKNOWN, PINNED] = [table.clay, table.inside, table.unknown, table.pinned].map(
  (text) => bytes(text) as unknown as Color,
);

// (STEPS, 4) from the lowest value to the highest: from light to dark, and for signed values on both sides of grey.
export function colorMap(signed: boolean): Uint8Array {
  const out = new Uint8Array(4 * STEPS).fill(255);
  const colors = bytes(signed ? table.diverging : table.sequential);
  for (let i = 0; i < STEPS; i++) out.set(colors.slice(3 * i, 3 * i + 3), 4 * i);
  return out;
}

function bytes(text: string): number[] {
  return text.match(/../g)!.map((pair) => parseInt(pair, 16));
}
