// A histogram of a field, with logarithmic counts, above the bar of its colours; dragging selects a range.

import { colorMap, STEPS } from "./colors";
import { checkbox, make, makeSvg, numberInput, short, withUnit } from "./dom";
import { Field } from "./model";

const BARS = 48;
const STOPS = 32;
const [WIDTH, HEIGHT, BAR] = [264, 76, 10];

export interface Series {
  label: string;
  values: Float32Array;
}

export class Histogram {
  readonly element: HTMLElement;
  private readonly title = make("h3", {});
  private readonly drawing = makeSvg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT + BAR + 4}`, class: "bars", role: "img", "aria-label": "Histogram" });
  private readonly ticks = make("div", { class: "ticks" });
  private readonly caption = make("p", { class: "note" });
  private readonly lower: ReturnType<typeof numberInput>;
  private readonly upper: ReturnType<typeof numberInput>;
  private readonly clear: HTMLButtonElement;
  private readonly log = checkbox("Log scale of counts", () => this.logarithmic, (on) => {
    this.logarithmic = on;
    this.redraw();
  });
  private logarithmic = true; // else all but the most frequent values are too few to be seen
  private redraw = () => {};
  private field: Field | null = null;
  private limits: [number, number] = [0, 1];
  private counted = new WeakMap<Float32Array, { limits: [number, number]; counts: number[] }>();

  constructor(private readonly pick: (range: [number, number] | null) => void) {
    const typed = () => {
      const [low, high] = [this.lower, this.upper].map(({ element }) => (element.value === "" ? NaN : Number(element.value)));
      if (Number.isNaN(low) && Number.isNaN(high)) this.pick(null);
      else this.pick([Number.isNaN(low) ? -Infinity : low, Number.isNaN(high) ? Infinity : high]);
    };
    this.lower = numberInput("Highlight values from", typed);
    this.upper = numberInput("Highlight values to", typed);
    this.clear = make("button", { type: "button", click: () => this.pick(null) }, "Clear");
    this.element = make(
      "div",
      { class: "histogram" },
      this.title,
      this.drawing as unknown as HTMLElement,
      this.ticks,
      this.caption,
      this.log.element,
      make("div", { class: "range" }, make("span", {}, "Highlight"), this.lower.element, "to", this.upper.element, this.clear),
    );
    this.drawing.addEventListener("pointerdown", (event) => this.drag(event as PointerEvent));
  }

  show(field: Field, series: Series[], limits: [number, number], range: [number, number] | null): void {
    this.field = field;
    this.limits = limits;
    const counts = series.map(({ values }) => this.countsOf(values));
    this.redraw = () => this.draw(series, counts, range);
    this.log.update();
    this.redraw();
  }

  // Count anew: the values have changed in place.
  forget(): void {
    this.counted = new WeakMap();
  }

  // A million values take too long to be counted at each movement of a pointer.
  private countsOf(values: Float32Array): number[] {
    const known = this.counted.get(values);
    if (known && String(known.limits) === String(this.limits)) return known.counts;
    const counts = this.count(values);
    this.counted.set(values, { limits: this.limits, counts });
    return counts;
  }

  // Values beyond the limits count in the outermost bars.
  private count(values: Float32Array): number[] {
    const counts = new Array<number>(BARS).fill(0);
    const scale = BARS / (this.limits[1] - this.limits[0]);
    for (const value of values) {
      if (Number.isNaN(value)) continue;
      counts[Math.min(Math.max(Math.floor((value - this.limits[0]) * scale), 0), BARS - 1)]++;
    }
    return counts;
  }

  private draw(series: Series[], counts: number[][], range: [number, number] | null): void {
    const field = this.field!;
    const [low, high] = this.limits;
    const colors = colorMap(field.signed);
    const color = (place: number) => {
      const at = 4 * Math.round(place * (STEPS - 1));
      return `rgb(${colors[at]},${colors[at + 1]},${colors[at + 2]})`;
    };
    const tallest = Math.max(...counts.flat(), 1);
    const share = (count: number) => (this.logarithmic ? Math.log1p(count) / Math.log1p(tallest) : count / tallest);
    const y = (count: number) => HEIGHT - (count > 0 ? Math.max((HEIGHT - 2) * share(count), 1) : 0);
    const [step, parts] = [WIDTH / BARS, [] as Node[]];
    const last = counts.length - 1;
    counts[last].forEach((count, i) => {
      const middle = low + ((i + 0.5) / BARS) * (high - low);
      const lit = !range || (middle >= range[0] && middle <= range[1]);
      const box = { x: i * step, y: y(count), width: step - 0.6, height: HEIGHT - y(count) };
      parts.push(makeSvg("rect", { ...box, class: lit ? "bar" : "bar dim" }));
    });
    if (last > 0) {
      const outline = counts[0].map((count, i) => `H${i * step}V${y(count)}H${(i + 1) * step}`).join("");
      parts.push(makeSvg("path", { d: `M0 ${HEIGHT}${outline}V${HEIGHT}`, class: "outline" }));
    }
    const stops = Array.from({ length: STOPS + 1 }, (_, i) => makeSvg("stop", { offset: i / STOPS, "stop-color": color(i / STOPS) }));
    parts.push(makeSvg("linearGradient", { id: "color-bar" }, ...stops));
    parts.push(makeSvg("rect", { x: 0, y: HEIGHT + 4, width: WIDTH, height: BAR, fill: "url(#color-bar)" }));
    this.drawing.replaceChildren(...parts);
    this.drawing.setAttribute("aria-label", `${field.label}: histogram from ${withUnit(low, field.unit)} to ${withUnit(high, field.unit)}`);
    const marks = [low, (low + high) / 2, high].map((value) => make("span", {}, field.unit === "°" ? `${short(value)}°` : short(value)));
    this.ticks.replaceChildren(...marks);
    const what = field.at === "face" ? "faces" : "vertices";
    this.title.textContent = field.unit === "" ? field.label : `${field.label} (${field.unit})`;
    this.caption.textContent = [
      `Number of ${what}. `,
      last > 0 ? `${series[last].label} filled, ${series[0].label.toLowerCase()} outlined. ` : "",
      "Drag to highlight a range.",
    ].join("");
    this.lower.show(range && Number.isFinite(range[0]) ? short(range[0]) : "");
    this.upper.show(range && Number.isFinite(range[1]) ? short(range[1]) : "");
    this.clear.disabled = range === null;
  }

  // The outermost bars reach as far as there are values.
  private drag(event: PointerEvent): void {
    const box = this.drawing.getBoundingClientRect();
    const bar = (at: PointerEvent) =>
      Math.min(Math.max(Math.floor(((at.clientX - box.left) / box.width) * BARS), 0), BARS - 1);
    const start = bar(event);
    const value = (edge: number) =>
      edge <= 0 ? -Infinity : edge >= BARS ? Infinity : this.limits[0] + (edge / BARS) * (this.limits[1] - this.limits[0]);
    const move = (at: PointerEvent) => {
      const [first, second] = [Math.min(start, bar(at)), Math.max(start, bar(at)) + 1];
      this.pick(first === 0 && second === BARS ? null : [value(first), value(second)]);
    };
    const end = () => {
      this.drawing.removeEventListener("pointermove", move as EventListener);
      this.drawing.removeEventListener("pointerup", end);
      this.drawing.removeEventListener("pointercancel", end);
    };
    this.drawing.setPointerCapture(event.pointerId);
    this.drawing.addEventListener("pointermove", move as EventListener);
    this.drawing.addEventListener("pointerup", end);
    this.drawing.addEventListener("pointercancel", end);
    event.preventDefault();
    move(event);
  }
}
