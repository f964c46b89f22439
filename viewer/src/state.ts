// What is seen, and the same in the hash of the address, so that a link shows it again.

export type Mode = "one" | "split" | "side";
export const MODES: Mode[] = ["one", "split", "side"];
export type Up = "y" | "z";
export const UPS: Up[] = ["y", "z"];
export const LIGHTS = ["clay", "matcap", "raking", "unlit"] as const;
export type Light = (typeof LIGHTS)[number];

export interface View {
  from: number[]; // unit vector from the target toward the viewer
  target: number[]; // in the frame of the model
  distance: number;
}

export interface State {
  mode: Mode;
  left: string; // names of surfaces
  right: string;
  split: number; // share of the width
  light: Light;
  angle: number; // of the raking light, in degrees
  smooth: boolean;
  wireframe: boolean;
  up: Up; // axis of the mesh that points up on the screen
  color: string; // "", "vertex" or the name of a field
  limits: [number, number] | null; // of the colours, where not those of the field
  range: [number, number] | null; // of the values that are lit up
  view: View;
}

const digits = (value: number) => String(Number(value.toPrecision(5)));

export function toHash(state: State): string {
  const parts: [string, string][] = [
    ["mode", state.mode],
    ["left", state.left],
    ["right", state.right],
    ["split", digits(state.split)],
    ["light", state.light],
    ["angle", digits(state.angle)],
    ["smooth", state.smooth ? "1" : "0"],
    ["wireframe", state.wireframe ? "1" : "0"],
    ["up", state.up],
    ["color", state.color],
    ["limits", state.limits?.map(digits).join(",") ?? ""],
    ["range", state.range?.map(digits).join(",") ?? ""],
    ["view", [...state.view.from, ...state.view.target, state.view.distance].map(digits).join(",")],
  ];
  return `#${parts.filter(([, value]) => value !== "").map(([name, value]) => `${name}=${encodeURIComponent(value)}`).join("&")}`;
}

// What a hash asks for; anything that makes no sense is left as it is.
export function fromHash(hash: string, state: State, surfaces: string[], colors: string[]): State {
  const given = new URLSearchParams(hash.replace(/^#/, ""));
  const one = <T extends string>(name: string, known: readonly T[], otherwise: T): T => {
    const value = given.get(name) as T | null;
    return value !== null && known.includes(value) ? value : otherwise;
  };
  const numbers = (name: string, count: number): number[] | null => {
    const values = given.get(name)?.split(",").map(Number);
    return values?.length === count && values.every(Number.isFinite) ? values : null;
  };
  const pair = (name: string, otherwise: State["range"]) => (numbers(name, 2) as [number, number] | null) ?? otherwise;
  const view = numbers("view", 7);
  const visible = view && Math.hypot(...view.slice(0, 3)) > 0 && view[6] > 0;
  return {
    mode: one("mode", MODES, state.mode),
    left: one("left", surfaces, state.left),
    right: one("right", surfaces, state.right),
    split: Math.min(Math.max(numbers("split", 1)?.[0] ?? state.split, 0), 1),
    light: one("light", LIGHTS, state.light),
    angle: numbers("angle", 1)?.[0] ?? state.angle,
    smooth: one("smooth", ["0", "1"], state.smooth ? "1" : "0") === "1",
    wireframe: one("wireframe", ["0", "1"], state.wireframe ? "1" : "0") === "1",
    up: one("up", UPS, state.up),
    color: one("color", colors, state.color),
    limits: pair("limits", state.limits),
    range: pair("range", state.range),
    view: visible ? { from: view.slice(0, 3), target: view.slice(3, 6), distance: view[6] } : state.view,
  };
}

// The command that draws the same surfaces from the same place; the view is in the unit of the files.
export function renderCommand(files: string[], view: View, state: State, reference: string | null): string {
  const quoted = (file: string) => {
    const path = file.startsWith("-") ? `./${file}` : file; // otherwise it is taken for an option
    return /^[\w@%+=:,./-]+$/.test(path) ? path : `'${path.replaceAll("'", "'\"'\"'")}'`;
  };
  const row = (values: number[]) => values.map(digits).join(",");
  const words = ["cascadenorm render", ...files.map(quoted), "-o view.png"];
  words.push(`--view=${row(view.from)}`, `--target=${view.target.join(",")}`, `--distance=${digits(view.distance)}`);
  if (state.up !== "y") words.push(`--up=${state.up}`);
  if (state.smooth) words.push("--smooth");
  if (state.wireframe) words.push("--wireframe");
  if (state.color && state.color !== "vertex") {
    words.push(`--values=${state.color}`);
    if (reference) words.push(`--reference=${quoted(reference)}`);
    if (state.limits) words.push(`--limits=${row(state.limits)}`);
  }
  return words.join(" ");
}
