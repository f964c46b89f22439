// The viewer: the canvas, the panel beside it, and what lies over the canvas.

import { Vector3 } from "three";
import { make } from "./dom";
import { Place } from "./format";
import { Field, Model } from "./model";
import { Panel, Where } from "./panel";
import { Stage } from "./stage";
import { fromHash, Mode, State, toHash } from "./state";

export class Viewer {
  readonly stage: Stage;
  readonly holder = make("div", { class: "stage" });
  private readonly panel: Panel;
  private readonly names = make("div", { class: "names", "aria-hidden": "true" });
  private readonly handle = make("div", {
    class: "handle",
    role: "slider",
    tabindex: 0,
    "aria-label": "Position of the split",
    "aria-valuemin": 0,
    "aria-valuemax": 100,
  });
  private readonly rings = make("div", { class: "rings", "aria-hidden": "true" });
  private readonly decimated = make("p", { class: "decimated" });
  private place: Vector3 | null = null;
  private picked: { name: string; face: number } | null = null;
  private saving = 0;

  constructor(
    root: HTMLElement,
    private model: Model,
    where: Where = { linked: true },
  ) {
    this.stage = new Stage(model, initial(model));
    this.panel = new Panel(model, this.stage, (change) => this.change(change), where);
    const { canvas } = this.stage;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", "3-D view of the mesh; arrow keys rotate it, plus and minus zoom");
    this.holder.append(canvas, this.names, this.rings, this.handle, this.decimated);
    root.replaceChildren(this.holder, this.panel.element);
    root.classList.add("live");
    this.theme();
    this.noteDecimated();
    this.readHash();
    this.stage.onMove = () => this.save();
    this.stage.onFrame = () => this.overlay();
    new ResizeObserver(() => this.stage.resized()).observe(this.holder);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.theme());
    addEventListener("hashchange", () => this.readHash());
    this.listen(canvas);
    this.offerPlaces();
  }

  // Show other meshes: from the same place if they lie where the former ones do, else as a whole.
  show(model: Model, samePlace: boolean): void {
    const before = this.model.surfaces.map(({ name }) => name).join();
    const faces = (of: Model) => of.surfaces.find(({ name }) => name === this.picked?.name)?.triangles;
    if (faces(model) !== faces(this.model)) this.picked = null;
    this.model = model;
    this.place = null;
    const { state, atHome, mode } = this.stage;
    this.stage.show(model, samePlace);
    if (before !== model.surfaces.map(({ name }) => name).join()) Object.assign(state, sides(model, state.mode));
    if (!this.stage.field && state.color !== "vertex") Object.assign(state, { color: "", limits: null, range: null });
    if (atHome && this.stage.mode !== mode) this.stage.look(this.stage.home()); // it stays whole in other panes
    this.panel.show(model);
    this.stage.mark(this.picked);
    this.panel.describe(this.picked);
    this.noteDecimated();
    this.change({});
  }

  // The values of a field have changed.
  repaint(field: Field): void {
    this.stage.repaint(field);
    this.panel.repaint();
  }

  change(change: Partial<State>): void {
    const whole = "mode" in change && this.stage.atHome; // it stays whole in panes of another width
    if (change.up) this.stage.setUp(change.up);
    Object.assign(this.stage.state, change);
    if (whole) this.stage.look(this.stage.home());
    this.panel.update();
    this.stage.draw();
    this.save();
  }

  private noteDecimated(): void {
    const fewer = this.model.surfaces.filter(({ faces, triangles }) => faces > triangles.length / 3);
    const said = fewer.map(({ label, faces, triangles }) => `${label}: ${triangles.length / 3} of ${faces} faces`);
    this.decimated.hidden = !fewer.length;
    this.decimated.textContent = `Decimated for display. ${said.join("; ")}.`;
  }

  private readHash(): void {
    const { surfaces, fields } = this.model;
    const colors = ["", "vertex", ...fields.map(({ name }) => name)];
    const before = this.stage.state;
    this.stage.state = fromHash(location.hash, before, surfaces.map(({ name }) => name), colors);
    const { view } = this.stage.state;
    this.stage.look(view === before.view ? this.stage.home() : view);
    this.panel.update();
  }

  // Browsers refuse to change the address many times a second.
  private save(): void {
    clearTimeout(this.saving);
    this.saving = window.setTimeout(() => {
      this.stage.state.view = this.stage.view();
      history.replaceState(null, "", toHash(this.stage.state));
    }, 250);
  }

  private theme(): void {
    const style = getComputedStyle(document.documentElement);
    this.stage.background = style.getPropertyValue("--stage").trim();
    this.stage.accent = style.getPropertyValue("--accent").trim();
  }

  // What lies over the canvas: names, the handle of the split, rings around a place.
  private overlay(): void {
    const panes = this.stage.panes();
    const label = (name: string) => this.model.surfaces.find((one) => one.name === name)!.label;
    this.names.replaceChildren(
      ...panes.map(({ name, from, to }, i) => {
        const last = i > 0 && this.stage.mode === "split";
        const side = last ? `right:${this.stage.canvas.clientWidth - to}px` : `left:${from}px`;
        return make("span", { style: side }, label(name));
      }),
    );
    this.handle.hidden = this.stage.mode !== "split";
    this.handle.style.left = `${100 * this.stage.state.split}%`;
    this.handle.setAttribute("aria-valuenow", String(Math.round(100 * this.stage.state.split)));
    const seen = this.place ? this.stage.project(this.place) : [];
    this.rings.replaceChildren(
      ...seen.flatMap((at) => (at ? [make("i", { style: `left:${at.x}px;top:${at.y}px` })] : [])),
    );
  }

  private listen(canvas: HTMLCanvasElement): void {
    let pressed: PointerEvent | null = null;
    canvas.addEventListener("pointerdown", (event) => (pressed = event));
    canvas.addEventListener("pointerup", (event) => {
      const moved = pressed ? Math.hypot(event.clientX - pressed.clientX, event.clientY - pressed.clientY) : Infinity;
      if (event.button === 0 && moved < 4) this.pick(event.offsetX, event.offsetY);
    });
    this.holder.addEventListener("keydown", (event) => this.key(event));
    const drag = (event: PointerEvent) => {
      const box = this.holder.getBoundingClientRect();
      this.change({ split: Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1) });
    };
    this.handle.addEventListener("pointerdown", (event) => {
      this.handle.setPointerCapture(event.pointerId);
      this.handle.addEventListener("pointermove", drag);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      this.handle.addEventListener(end, () => this.handle.removeEventListener("pointermove", drag));
    }
    canvas.addEventListener("webglcontextlost", () => {
      this.holder.append(make("p", { class: "lost", role: "alert" }, "The browser has stopped drawing. Reload the page."));
    });
  }

  private pick(x: number, y: number): void {
    this.picked = this.stage.pick(x, y);
    this.stage.mark(this.picked);
    this.panel.describe(this.picked);
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { state } = this.stage;
    const several = this.model.surfaces.length > 1;
    const onHandle = event.target === this.handle;
    const step = 0.15;
    const split = (by: number) => this.change({ split: Math.min(Math.max(state.split + by, 0), 1) });
    const actions: Record<string, () => void> = {
      ArrowLeft: () => (onHandle ? split(-0.02) : this.stage.turn(-step, 0)),
      ArrowRight: () => (onHandle ? split(0.02) : this.stage.turn(step, 0)),
      ArrowUp: () => (onHandle ? split(0.02) : this.stage.turn(0, step)),
      ArrowDown: () => (onHandle ? split(-0.02) : this.stage.turn(0, -step)),
      ...(onHandle && { Home: () => split(-1), End: () => split(1) }),
      "+": () => this.stage.turn(0, 0, 1.2),
      "=": () => this.stage.turn(0, 0, 1.2),
      "-": () => this.stage.turn(0, 0, 1 / 1.2),
      f: () => this.stage.look(this.stage.home()),
      s: () => this.change({ smooth: !state.smooth }),
      w: () => this.change({ wireframe: !state.wireframe }),
      ...(several && {
        b: () => this.change({ mode: "one", left: state.right, right: state.left }),
        1: () => this.change({ mode: "one" }),
        2: () => this.change({ mode: "split" }),
        3: () => this.change({ mode: "side" }),
      }),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    action();
    event.preventDefault();
  }

  // The places that the text names become buttons.
  private offerPlaces(): void {
    for (const item of document.querySelectorAll<HTMLElement>("[data-place]")) {
      const place = this.model.places[Number(item.dataset.place)];
      item.replaceChildren(make("button", { type: "button", click: () => this.fly(place) }, place.label));
    }
  }

  private fly(place: Place): void {
    const { center, size } = this.model;
    this.place = new Vector3(...place.at.map((value, axis) => (value - center[axis]) / size));
    const shown = this.stage.panes().some(({ name }) => name === place.mesh);
    if (!shown) this.change({ left: place.mesh });
    this.holder.scrollIntoView({ block: "nearest" });
    this.stage.fly(place.mesh, this.place, place.radius / size);
  }
}

// The first two surfaces; alone, the second, which is the result.
function sides({ surfaces }: Model, mode: Mode): Pick<State, "left" | "right"> {
  const [first, second] = [surfaces[0].name, surfaces[Math.min(1, surfaces.length - 1)].name];
  return mode === "one" ? { left: second, right: first } : { left: first, right: second };
}

function initial(model: Model): State {
  return {
    mode: "split",
    ...sides(model, "split"),
    split: 0.5,
    light: "clay",
    angle: 150,
    smooth: false,
    wireframe: false,
    up: "y",
    color: "",
    limits: null,
    range: null,
    view: { from: model.view.from, target: model.view.target, distance: 4 * model.radius },
  };
}
