// The form of methods, parameters and controls, made from what the server says of them.

import { make } from "../dom";
import type { Form, Input, Settings } from "./api";

const STRENGTH = "strength";
const [MOST, STEP] = [2, 0.05]; // of the slider; the number beside it takes any

// What is typed, by name; what is not there is as it is by default.
export interface Values {
  method: string;
  parameters: Record<string, Record<string, string>>; // by method
  controls: Record<string, string>;
}

export class SettingsForm {
  readonly element = make("form", { class: "settings", submit: (event: Event) => event.preventDefault() });
  values: Values;
  private readonly method: HTMLSelectElement;
  private readonly about = make("p", { class: "about" });
  private readonly rule = make("p", { class: "note" });
  private readonly parameters = make("div", { class: "fields" });
  private readonly controls = make("div", { class: "fields" });
  private readonly slider = make("input", { type: "range", min: 0, max: MOST, step: STEP, "aria-label": "Strength" });
  private readonly strength: HTMLInputElement;

  // `changing` is called as a value changes, and `changed` when that is over: a slider let go, a field left.
  constructor(
    private readonly form: Form,
    private readonly changing: () => void,
    private readonly changed: () => void,
  ) {
    this.values = { method: form.default, parameters: {}, controls: {} };
    this.method = make(
      "select",
      { change: () => this.set(() => (this.values.method = this.method.value), true) },
      ...offered(form),
    );
    const strength = form.controls.find(({ name }) => name === STRENGTH)!;
    this.strength = this.input("controls", strength) as HTMLInputElement;
    this.strength.setAttribute("aria-label", "Strength, any number");
    const slide = (over: boolean) => this.set(() => this.put("controls", strength, this.slider.value), over);
    this.slider.addEventListener("input", () => slide(false));
    this.slider.addEventListener("change", () => slide(true));
    this.element.append(
      make("label", { class: "row" }, make("span", {}, "Method"), this.method),
      this.about,
      this.rule,
      make("div", { class: "row strength", title: strength.help }, make("span", {}, "Strength"), this.slider, this.strength),
      make("details", {}, make("summary", {}, "Method parameters"), this.parameters),
      make("details", {}, make("summary", {}, "Region and limits"), this.controls),
    );
    this.update();
  }

  // What the server is asked for.
  get settings(): Settings {
    const { method, parameters, controls } = this.values;
    return { method, parameters: parameters[method] ?? {}, controls };
  }

  show(values: Values): void {
    this.values = structuredClone(values);
    this.update();
  }

  // Mark the field of a setting that is refused, and no other.
  mark(refused: string): void {
    for (const field of this.element.querySelectorAll<HTMLInputElement | HTMLSelectElement>("[name]")) {
      if (field.name !== refused) {
        field.removeAttribute("aria-invalid");
        continue;
      }
      field.setAttribute("aria-invalid", "true");
      field.scrollIntoView({ block: "nearest" }); // the message may lie over it
    }
  }

  private set(change: () => void, over: boolean): void {
    change();
    this.update();
    this.changing();
    if (over) this.changed();
  }

  private put(kind: "parameters" | "controls", { name, default: usual }: Input, value: string): void {
    const { method, parameters, controls } = this.values;
    const values = kind === "controls" ? controls : (parameters[method] ??= {});
    if (value.trim() === "" || value === usual) delete values[name];
    else values[name] = value;
  }

  private update(): void {
    const { method, parameters, controls } = this.values;
    const chosen = this.form.methods.find(({ name }) => name === method)!;
    this.method.value = method;
    this.about.textContent = chosen.about;
    this.rule.textContent = `${chosen.name}: ${chosen.summary.replace(/\.$/, "")} (${chosen.source}).`;
    this.fill(this.parameters, "parameters", chosen.settings, parameters[method] ?? {}, `${method}:`);
    this.fill(this.controls, "controls", this.form.controls.filter(({ name }) => name !== STRENGTH), controls, "");
    this.slider.value = this.strength.value = controls[STRENGTH] ?? "1";
  }

  // Make the inputs anew only where they are others: what has the focus keeps it.
  private fill(place: HTMLElement, kind: "parameters" | "controls", inputs: Input[], values: Record<string, string>, of: string): void {
    const key = of + inputs.map(({ name }) => name).join();
    if (place.dataset.key !== key) {
      place.dataset.key = key;
      const rows = inputs.map((input) => this.row(kind, input));
      place.replaceChildren(...(rows.length ? rows : [make("p", { class: "note" }, "This method has no parameters.")]));
    }
    for (const input of inputs) {
      const field = place.querySelector<HTMLInputElement | HTMLSelectElement>(`[name="${input.name}"]`)!;
      field.value = values[input.name] ?? (input.kind === "text" ? "" : input.default);
    }
  }

  private row(kind: "parameters" | "controls", input: Input): HTMLElement {
    const field = this.input(kind, input);
    const id = `${kind}-${input.name}`;
    field.id = id;
    field.setAttribute("aria-describedby", `${id}-help`);
    const range = [input.unit, input.allowed].filter(Boolean).join(", ");
    return make(
      "div",
      { class: `field ${input.kind}` },
      make("label", { for: id }, input.label),
      field,
      make("p", { class: "note", id: `${id}-help` }, sentence(range ? `${input.help.replace(/\.$/, "")} (${range})` : input.help)),
    );
  }

  private input(kind: "parameters" | "controls", input: Input): HTMLInputElement | HTMLSelectElement {
    if (input.kind === "choice") {
      const select = make(
        "select",
        { name: input.name },
        ...input.choices.map((value) => make("option", { value }, kind === "parameters" && value === "none" ? "automatic" : value)),
      );
      select.addEventListener("change", () => this.set(() => this.put(kind, input, select.value), true));
      return select;
    }
    const placeholder = input.example ? `e.g. ${input.example}` : input.default === "" ? "automatic" : input.default;
    const field = make("input", { name: input.name, type: input.kind, placeholder, autocomplete: "off", spellcheck: "false" });
    if (input.kind === "number") {
      field.step = input.whole ? "1" : "any";
      if (input.minimum !== null) field.min = String(input.minimum);
      if (input.maximum !== null) field.max = String(input.maximum);
    }
    field.addEventListener("change", () => this.set(() => this.put(kind, input, field.value), true));
    return field;
  }
}

// The default first, then the families.
function offered({ methods, default: usual }: Form): HTMLElement[] {
  const option = (name: string, text = name) => make("option", { value: name }, text);
  const groups = new Map<string, HTMLElement>();
  for (const { name, family } of methods) {
    if (name === usual) continue;
    if (!groups.has(family)) groups.set(family, make("optgroup", { label: family }));
    groups.get(family)!.append(option(name));
  }
  return [option(usual, `${usual} (recommended)`), ...groups.values()];
}

function sentence(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1).replace(/\.?$/, ".");
}
