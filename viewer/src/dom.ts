// Elements of the page, made briefly.

type Attributes = Record<string, string | number | boolean | EventListener>;

export function make<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: (Node | string)[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (typeof value === "boolean") element.toggleAttribute(name, value);
    else if (name === "style") element.style.cssText = String(value); // an attribute would need "unsafe-inline"
    else element.setAttribute(name, String(value));
  }
  element.append(...children);
  return element;
}

export function makeSvg(tag: string, attributes: Record<string, string | number> = {}, ...children: Node[]): SVGElement {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

// One of a few values, all to be seen: radio buttons in a row.
export function choice<T extends string>(
  legend: string,
  options: readonly (readonly [T, string])[],
  chosen: () => T,
  choose: (value: T) => void,
): { element: HTMLElement; update: () => void } {
  const inputs = options.map(([value]) =>
    make("input", { type: "radio", name: legend, value, change: () => choose(value) }),
  );
  const labels = options.map(([, label], i) => make("label", {}, inputs[i], make("span", {}, label)));
  const element = make("fieldset", { class: "choice" }, make("legend", {}, legend), make("div", {}, ...labels));
  const update = () => inputs.forEach((input) => (input.checked = input.value === chosen()));
  return { element, update };
}

// A drop-down list, whose options are read at each update.
export function selection(
  label: string,
  options: () => readonly (readonly [string, string])[],
  chosen: () => string,
  choose: (value: string) => void,
): { element: HTMLElement; update: () => void } {
  const select = make("select", { change: () => choose(select.value) });
  const element = make("label", { class: "row" }, make("span", {}, label), select);
  let offered = "";
  const update = () => {
    const now = options();
    if (String(now) !== offered) select.replaceChildren(...now.map(([value, text]) => make("option", { value }, text)));
    offered = String(now);
    select.value = chosen();
  };
  return { element, update };
}

// A number. What is shown does not replace a number that is being typed.
export function numberInput(label: string, changed: () => void): { element: HTMLInputElement; show: (text: string) => void } {
  let typing = false;
  const end = () => (typing = false);
  const element = make("input", { type: "number", step: "any", "aria-label": label, input: () => (typing = true), blur: end });
  element.addEventListener("change", () => (end(), changed()));
  return { element, show: (text) => void (typing || (element.value = text)) };
}

export function checkbox(
  label: string,
  checked: () => boolean,
  check: (value: boolean) => void,
): { element: HTMLElement; update: () => void } {
  const input = make("input", { type: "checkbox", change: () => check(input.checked) });
  return { element: make("label", { class: "check" }, input, label), update: () => void (input.checked = checked()) };
}

export function counted(count: number, one: string, several: string): string {
  return `${count.toLocaleString("en")} ${count === 1 ? one : several}`;
}

export function short(value: number): string {
  if (!Number.isFinite(value)) return "none";
  const size = Math.abs(value);
  return size !== 0 && (size < 1e-3 || size >= 1e5) ? value.toExponential(2) : String(Number(value.toPrecision(4)));
}

export function withUnit(value: number, unit: string): string {
  return !Number.isFinite(value) ? "none" : unit === "°" ? `${short(value)}°` : `${short(value)} ${unit}`.trim();
}
