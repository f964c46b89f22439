// Colours that stand for numbers: viridis, and for signed ones two hues of equal lightness on either side of grey.

export type Color = [number, number, number]; // sRGB, 0 to 255

export const STEPS = 256;
export const PINNED: Color = [240, 100, 30]; // of vertices that stay: none of the colours below

// viridis (van der Walt & Smith 2015, CC0), every sixteenth of its colours
const VIRIDIS = "44015448186a472d7b4240863b528b33638d2c728e26828e21918c1f9f8827ad813dbc745cc86381d34daadc32d5e21afde725";

export function colorMap(signed: boolean): Uint8Array {
  const out = new Uint8Array(4 * STEPS).fill(255);
  for (let i = 0; i < STEPS; i++) out.set((signed ? diverging : sequential)(i / (STEPS - 1)), 4 * i);
  return out;
}

function sequential(place: number): Color {
  const at = place * (VIRIDIS.length / 6 - 1);
  const low = Math.min(Math.floor(at), VIRIDIS.length / 6 - 2);
  const stop = (index: number) => [0, 2, 4].map((k) => parseInt(VIRIDIS.slice(6 * index + k, 6 * index + k + 2), 16));
  const [a, b] = [stop(low), stop(low + 1)];
  return a.map((value, c) => Math.round(value + (b[c] - value) * (at - low))) as Color;
}

// Straight lines in OKLab (Ottosson 2020) from blue over light grey to orange: even steps, told apart by the colour-blind.
function diverging(place: number): Color {
  const away = Math.abs(2 * place - 1);
  const hue = (place < 0.5 ? 250 : 55) * (Math.PI / 180);
  const chroma = 0.14 * away;
  return fromOklab(0.93 - 0.45 * away, chroma * Math.cos(hue), chroma * Math.sin(hue));
}

function fromOklab(L: number, a: number, b: number): Color {
  const l = (L + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (L - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (L - 0.0894841775 * a - 1.291485548 * b) ** 3;
  const light = [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ];
  return light.map((value) => {
    const c = Math.min(Math.max(value, 0), 1);
    return Math.round(255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055));
  }) as Color;
}
