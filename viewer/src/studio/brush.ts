// A brush that paints on the vertices of the mesh: how much they move, and which stay.

import { colorMap, PINNED as PIN_COLOR, STEPS } from "../colors";
import { choice, make } from "../dom";
import type { Field, Model } from "../model";
import type { Viewer } from "./viewer";

const FIELD = "paint";
const [FREE, PINNED] = [0, 255]; // codes, as cascadenorm/studio/painting.py reads them; 1 to 101 are weights in per cent
const CLICK_STEP = 0.5; // distance between two dabs, in radii of the brush

type Tool = "turn" | "mask" | "pin" | "erase";
const TOOLS: (readonly [Tool, string])[] = [["turn", "Off"], ["mask", "Weight"], ["pin", "Pin"], ["erase", "Erase"]];
const SAYS: Record<Tool, string> = {
  turn: "Paint weights to move vertices less, or pin vertices in place.",
  mask: "Paint the share of the displacement to apply; 0 % keeps vertices in place. Drag beside the mesh to rotate it.",
  pin: "Paint vertices to keep exactly in place. Drag beside the mesh to rotate it.",
  erase: "Erase paint. Drag beside the mesh to rotate it.",
};

export class Brush {
  readonly element: HTMLElement;
  codes = new Uint8Array(0); // one a vertex; made anew by each stroke, so that others may keep it
  private tool: Tool = "turn";
  private values = new Float32Array(0);
  private pinned = new Uint8Array(0);
  private field: Field | null = null;
  private viewer: Viewer | null = null;
  private last: { x: number; y: number } | null = null; // of the stroke, in CSS pixels
  private readonly size = make("input", { type: "range", min: 4, max: 120, value: 24 });
  private readonly weight = make("input", { type: "range", min: 0, max: 100, step: 5, value: 0 });
  private readonly percent = make("output", {});
  private readonly says = make("p", { class: "note" });
  private readonly clear = make("button", { type: "button", click: () => this.cleared() }, "Clear all paint");
  private readonly cursor = make("div", { class: "brush", "aria-hidden": "true", hidden: true });
  private readonly choice = choice("Brush", TOOLS, () => this.tool, (tool) => this.take(tool));
  private readonly weighs: HTMLElement;
  private readonly sizes: HTMLElement;
  private readonly legend = legend();

  // `painted` is called when a stroke is over.
  constructor(private readonly painted: () => void) {
    this.sizes = make("label", { class: "row" }, make("span", {}, "Size"), this.size);
    this.weighs = make("label", { class: "row" }, make("span", {}, "Weight"), this.weight, this.percent);
    this.weight.addEventListener("input", () => this.update());
    this.element = make("section", { class: "painting" }, this.choice.element, this.weighs, this.sizes, this.legend, this.says, this.clear);
    this.update();
  }

  // Begin without paint, on a mesh of so many vertices.
  open(count: number): void {
    this.codes = new Uint8Array(count);
    this.tool = "turn";
    this.field = this.last = null; // the mesh that is still shown is another one
    if (this.viewer?.stage.state.color === FIELD) this.viewer.change({ color: "", limits: null, range: null });
    this.update();
  }

  show(codes: Uint8Array<ArrayBuffer>): void {
    this.codes = codes;
    this.last = null; // a stroke would go on in them
    this.repaint();
    this.update();
  }

  // Give the model the paint as a field; a coarse one has other vertices, and none.
  paintOn(model: Model): void {
    const surfaces = model.surfaces.filter(({ positions }) => positions.length === 3 * this.codes.length);
    this.field = null;
    if (surfaces.length < model.surfaces.length) return;
    this.values = new Float32Array(this.codes.length);
    this.pinned = new Uint8Array(this.codes.length);
    this.field = {
      name: FIELD,
      label: "Painted weight",
      unit: "",
      at: "vertex",
      signed: false,
      against: null,
      limits: [0, 1],
      values: new Map(surfaces.map(({ name }) => [name, this.values])),
      pinned: this.pinned,
    };
    model.fields.push(this.field);
    this.fill();
  }

  // Take over a viewer, after it shows a model.
  use(viewer: Viewer): void {
    if (this.viewer !== viewer) this.listen(viewer);
    this.viewer = viewer;
    if (this.tool !== "turn" && this.field) viewer.change({ color: FIELD });
  }

  private take(tool: Tool): void {
    this.tool = tool;
    if (this.viewer && this.field) this.viewer.change({ color: tool === "turn" ? "" : FIELD, limits: null, range: null });
    this.update();
  }

  private cleared(): void {
    this.codes = new Uint8Array(this.codes.length);
    this.repaint();
    this.update();
    this.painted();
  }

  private update(): void {
    this.choice.update();
    this.says.textContent = SAYS[this.tool];
    this.percent.textContent = `${this.weight.value} %`;
    this.weighs.hidden = this.tool !== "mask";
    this.sizes.hidden = this.legend.hidden = this.tool === "turn";
    this.clear.hidden = !this.codes.some((code) => code !== FREE);
    if (this.tool === "turn") this.cursor.hidden = true;
  }

  private fill(): void {
    this.codes.forEach((code, i) => this.set(i, code));
  }

  private set(vertex: number, code: number): void {
    this.values[vertex] = code === FREE ? NaN : code === PINNED ? 0 : (code - 1) / 100;
    this.pinned[vertex] = Number(code === PINNED);
  }

  // Other paint on the mesh that is shown.
  private repaint(): void {
    if (!this.field) return;
    this.fill();
    this.viewer!.repaint(this.field);
  }

  private listen(viewer: Viewer): void {
    const { holder, stage } = viewer;
    holder.append(this.cursor);
    const place = ({ clientX, clientY }: PointerEvent) => {
      const box = stage.canvas.getBoundingClientRect();
      return { x: clientX - box.left, y: clientY - box.top };
    };
    const begin = (event: PointerEvent) => {
      if (this.tool === "turn" || !this.field || event.button !== 0 || event.target !== stage.canvas) return;
      const at = place(event);
      if (!stage.pick(at.x, at.y)) return; // beside the mesh: it is turned
      event.stopPropagation();
      stage.canvas.setPointerCapture(event.pointerId);
      this.codes = this.codes.slice();
      this.last = null;
      this.stroke(at);
    };
    const move = (event: PointerEvent) => {
      const at = place(event);
      this.follow(at, event.pointerType);
      if (this.last && this.field) this.stroke(at); // a coarse mesh that comes meanwhile has none
    };
    const end = () => {
      if (!this.last) return;
      this.last = null;
      this.update();
      this.painted();
    };
    holder.addEventListener("pointerdown", begin, { capture: true });
    holder.addEventListener("pointermove", move);
    holder.addEventListener("pointerleave", () => (this.cursor.hidden = true));
    for (const over of ["pointerup", "pointercancel"]) holder.addEventListener(over, end);
  }

  private follow({ x, y }: { x: number; y: number }, pointer: string): void {
    this.cursor.hidden = this.tool === "turn" || pointer === "touch";
    const radius = Number(this.size.value);
    this.cursor.style.cssText = `left:${x - radius}px;top:${y - radius}px;width:${2 * radius}px;height:${2 * radius}px`;
  }

  // Paint from the last place of the stroke to this one.
  private stroke(to: { x: number; y: number }): void {
    const from = this.last ?? to;
    const dabs = Math.max(1, Math.ceil(Math.hypot(to.x - from.x, to.y - from.y) / (CLICK_STEP * Number(this.size.value))));
    for (let i = 1; i <= dabs; i++) this.dab(from.x + ((to.x - from.x) * i) / dabs, from.y + ((to.y - from.y) * i) / dabs);
    this.last = to;
    this.viewer!.stage.repaint(this.field!);
  }

  private dab(x: number, y: number): void {
    const { stage } = this.viewer!;
    const picked = stage.pick(x, y);
    if (!picked) return;
    const code = this.tool === "pin" ? PINNED : this.tool === "erase" ? FREE : 1 + Number(this.weight.value);
    const radius = stage.lengthAt(picked.point, Number(this.size.value));
    for (const vertex of stage.picker(picked.name).around(picked.face, picked.point, radius)) {
      this.codes[vertex] = code;
      this.set(vertex, code);
    }
  }
}

// What the colours of paint mean.
function legend(): HTMLElement {
  const map = colorMap(false);
  const stops = [0, 64, 128, 192, STEPS - 1].map((step) => `rgb(${map.subarray(4 * step, 4 * step + 3).join()})`);
  const swatch = (background: string, kind: string) => make("i", { class: kind, style: `background:${background}`, "aria-hidden": "true" });
  return make(
    "p",
    { class: "legend note" },
    make("span", {}, swatch(`rgb(${PIN_COLOR.join()})`, "one"), "Pinned"),
    make("span", {}, "Weight 0 %", swatch(`linear-gradient(to right,${stops.join()})`, "many"), "100 %"),
  );
}
