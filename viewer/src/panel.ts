// The controls beside the canvas; each shows the state and changes it.

import { checkbox, choice, make, numberInput, selection, short, withUnit } from "./dom";
import { Histogram } from "./histogram";
import { Model, valueAt } from "./model";
import { Stage } from "./stage";
import { Light, Mode, renderCommand, State, Up } from "./state";

const KEYS: [string, string][] = [
  ["drag, arrow keys", "rotate"],
  ["right drag, two fingers", "pan"],
  ["wheel, + and −", "zoom"],
  ["click", "inspect a face"],
  ["B", "switch between two meshes"],
  ["1, 2, 3", "one, split, side by side"],
  ["S, W", "smooth shading, wireframe"],
  ["F", "reset the view"],
];

// What the page around the viewer is.
export interface Where {
  linked: boolean; // whether its address leads to the same view again
  unsaved?: () => boolean; // whether a file of the last surface is still to be written
}

export class Panel {
  readonly element = make("div", { class: "panel" });
  private readonly updates: (() => void)[] = [];
  private readonly histogram: Histogram;
  private readonly figures = make("div", { class: "figures", "aria-live": "polite" });
  private readonly hint = make("p", { class: "note" }, "Click a face to inspect it.");
  private readonly copied = make("p", { class: "note", role: "status" });

  constructor(
    private model: Model,
    private readonly stage: Stage,
    private readonly change: (change: Partial<State>) => void,
    private readonly where: Where,
  ) {
    this.histogram = new Histogram((range) => change({ range }));
    this.element.append(this.compared(), this.painted(), this.lit(), this.picked(), this.links(), keys());
  }

  // Show another model with the same elements, so that the focus and the scroll position stay.
  show(model: Model): void {
    this.model = model;
    this.copied.replaceChildren();
  }

  private get state(): State {
    return this.stage.state;
  }

  update(): void {
    for (const update of this.updates) update();
  }

  // The values of a field have changed.
  repaint(): void {
    this.histogram.forget();
    this.update();
  }

  private add(control: { element: HTMLElement; update: () => void }): HTMLElement {
    this.updates.push(control.update);
    return control.element;
  }

  private compared(): HTMLElement {
    const names = () => this.model.surfaces.map(({ name, label }) => [name, label] as const);
    const modes: (readonly [Mode, string])[] = [["one", "One"], ["split", "Split"], ["side", "Side by side"]];
    const left = this.add(selection("Left", names, () => this.state.left, (left) => this.change({ left })));
    const right = this.add(selection("Right", names, () => this.state.right, (right) => this.change({ right })));
    const section = make(
      "section",
      {},
      this.add(choice("Compare", modes, () => this.state.mode, (mode) => this.change({ mode }))),
      make("div", { class: "pair" }, left, right),
    );
    this.updates.push(() => {
      section.hidden = this.model.surfaces.length === 1;
      left.querySelector("span")!.textContent = this.state.mode === "one" ? "Shown" : "Left";
      right.querySelector("span")!.textContent = this.state.mode === "one" ? "Key B" : "Right";
    });
    return section;
  }

  private painted(): HTMLElement {
    const options = () => {
      const { surfaces, fields } = this.model;
      const own: [string, string][] = surfaces.some(({ colors }) => colors) ? [["vertex", "Vertex colours"]] : [];
      return [["", "None"], ...own, ...fields.map(({ name, label }) => [name, label])] as [string, string][];
    };
    const color = this.add(
      selection("Colour", options, () => this.state.color, (color) => this.change({ color, limits: null, range: null })),
    );
    const typed = () => {
      const [low, high] = ends.map(({ element }) => Number(element.value));
      this.change({ limits: Number.isFinite(low) && low < high ? [low, high] : null, range: null });
    };
    const ends = ["Lower limit of the colours", "Upper limit of the colours"].map((label) => numberInput(label, typed));
    const scale = make("div", { class: "range" }, make("span", {}, "Limits"), ends[0].element, "to", ends[1].element);
    const reset = make("button", { type: "button", click: () => this.change({ limits: null }) }, "Reset");
    scale.append(reset);
    this.updates.push(() => {
      const { field } = this.stage;
      this.histogram.element.hidden = scale.hidden = field === null;
      if (!field) return;
      const shown = [...new Set(this.stage.panes().map(({ name }) => name))];
      const series = shown.flatMap((name) => {
        const values = field.values.get(name);
        return values ? [{ label: this.label(name), values }] : [];
      });
      const apart = series.filter(({ values }, i) => series.findIndex((one) => one.values === values) === i);
      this.histogram.element.hidden = apart.length === 0;
      if (apart.length) this.histogram.show(field, apart, this.stage.limits, this.state.range);
      ends.forEach(({ show }, end) => show(short(this.stage.limits[end])));
      reset.disabled = this.state.limits === null;
    });
    return make("section", {}, color, this.histogram.element, scale);
  }

  private lit(): HTMLElement {
    const lights: (readonly [Light, string])[] = [
      ["clay", "Clay"],
      ["matcap", "Matcap"],
      ["raking", "Raking"],
      ["unlit", "Unlit"],
    ];
    const slider = make("input", { type: "range", min: 0, max: 360, step: 5 });
    slider.addEventListener("input", () => this.change({ angle: Number(slider.value) }));
    const angle = make("label", { class: "row" }, make("span", {}, "Direction"), slider);
    const ups: (readonly [Up, string])[] = [["y", "Y up"], ["z", "Z up"]];
    this.updates.push(() => {
      angle.hidden = this.state.light !== "raking";
      slider.value = String(this.state.angle);
    });
    return make(
      "section",
      {},
      this.add(choice("Light", lights, () => this.state.light, (light) => this.change({ light }))),
      angle,
      make(
        "div",
        { class: "checks" },
        this.add(checkbox("Smooth shading", () => this.state.smooth, (smooth) => this.change({ smooth }))),
        this.add(checkbox("Wireframe", () => this.state.wireframe, (wireframe) => this.change({ wireframe }))),
      ),
      this.add(choice("Up axis", ups, () => this.state.up, (up) => this.change({ up }))),
    );
  }

  private picked(): HTMLElement {
    this.figures.append(this.hint);
    return make("section", {}, make("h3", {}, "Face"), this.figures);
  }

  // Say what is known of a face.
  describe(picked: { name: string; face: number } | null): void {
    if (!picked) {
      if (!this.hint.isConnected) this.figures.replaceChildren(this.hint); // screen readers announce every change here
      return;
    }
    const surface = this.model.surfaces.find(({ name }) => name === picked.name)!;
    const triangle = this.stage.picker(picked.name).triangle(picked.face);
    const middle = triangle.a.clone().add(triangle.b).add(triangle.c).divideScalar(3);
    const at = middle.toArray().map((value, axis) => short(value * this.model.size + this.model.center[axis]));
    const whole = surface.faces === surface.triangles.length / 3;
    const number = surface.numbers ? surface.numbers[picked.face] : whole ? picked.face : null;
    const rows: [string, string][] = [
      [surface.label, number === null ? "face of the display mesh" : `face ${number}`],
      ["Centroid", at.join(", ")],
      ["Area", `${short(triangle.getArea() * this.model.size ** 2)} mesh units²`],
      ...this.model.fields
        .filter(({ values }) => values.has(picked.name))
        .map((field) => [field.label, withUnit(valueAt(field, surface, picked.face), field.unit)] as [string, string]),
    ];
    this.figures.replaceChildren(
      make("dl", {}, ...rows.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)])),
    );
  }

  private links(): HTMLElement {
    const copy = async (text: string, needs = "") => {
      try {
        await navigator.clipboard.writeText(text);
        this.copied.textContent = `Copied.${needs}`;
      } catch {
        this.copied.replaceChildren("Copy this: ", make("code", {}, text), needs);
      }
    };
    const file = (name: string) => this.model.surfaces.find((one) => one.name === name)?.file ?? null;
    const files = () => [...new Set(this.stage.panes().map(({ name }) => file(name)!))];
    const command = () => {
      const against = this.stage.field?.against;
      const reference = against ? file(against === "truth" ? "truth" : "before") : null;
      const { from, target, distance } = this.stage.view();
      const { center, size } = this.model;
      const there = target.map((value, axis) => Number((value * size + center[axis]).toPrecision(9)));
      const state = this.stage.field?.pinned ? { ...this.state, color: "" } : this.state; // no file has the paint
      return renderCommand(files(), { from, target: there, distance: distance * size }, state, reference);
    };
    const unsaved = () => {
      const last = this.model.surfaces[this.model.surfaces.length - 1].file;
      return this.where.unsaved?.() && files().includes(last) ? ` It reads ${last}: save the result first.` : "";
    };
    const button = (label: string, click: () => void) => make("button", { type: "button", click }, label);
    const again = button("Copy link to this view", () => void copy(location.href));
    const drawing = button("Copy view as command line", () => void copy(command(), unsaved()));
    again.hidden = !this.where.linked;
    this.updates.push(() => (drawing.hidden = !this.model.surfaces.every((surface) => surface.file)));
    const reset = button("Reset view", () => this.stage.look(this.stage.home()));
    return make("section", {}, make("div", { class: "buttons" }, reset, again, drawing), this.copied);
  }

  private label(name: string): string {
    return this.model.surfaces.find((one) => one.name === name)!.label;
  }
}

function keys(): HTMLElement {
  const rows = KEYS.flatMap(([key, does]) => [make("dt", {}, key), make("dd", {}, does)]);
  return make("details", {}, make("summary", {}, "Keys and gestures"), make("dl", { class: "keys" }, ...rows));
}
