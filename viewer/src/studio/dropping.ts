// Files that are dropped on the page or picked.

import { make } from "../dom";

export class Dropping {
  readonly button = make("button", { type: "button", click: () => this.input.click() }, "Open…");
  readonly zone: HTMLElement;
  private readonly input = make("input", { type: "file", multiple: true, "aria-label": "Mesh file, with those that belong to it" });

  constructor(private readonly take: (files: File[]) => unknown) {
    this.input.addEventListener("change", () => {
      this.give(this.input.files);
      this.input.value = "";
    });
    const pick = make("button", { type: "button", class: "primary", click: () => this.input.click() }, "Choose a file");
    this.zone = make(
      "div",
      { class: "zone" },
      make("p", {}, make("strong", {}, "Drop a mesh here")),
      make("p", { class: "note" }, "PLY, OBJ, STL, OFF, glTF and other formats. Drop the materials and textures of an OBJ file with it."),
      pick,
    );
    this.zone.hidden = true; // until it is known that no file was given
    this.input.hidden = true;
    document.body.append(this.input);
    let depth = 0; // of the elements that the pointer has entered
    const over = (by: number) => document.body.classList.toggle("dropping", (depth += by) > 0);
    addEventListener("dragenter", (event) => (event.preventDefault(), over(1)));
    addEventListener("dragleave", () => over(-1));
    addEventListener("dragover", (event) => event.preventDefault());
    addEventListener("drop", (event) => {
      event.preventDefault();
      over(-depth);
      this.give(event.dataTransfer?.files ?? null);
    });
  }

  private give(files: FileList | null): void {
    const all = [...(files ?? [])];
    const shown = all.filter(({ name }) => !name.startsWith(".")); // a folder's hidden files come with the others
    if (all.length) this.take(shown.length ? shown : all);
  }
}
