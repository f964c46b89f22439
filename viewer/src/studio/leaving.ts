// The question before work that is not saved is lost to another mesh.

import { make } from "../dom";

export class Leaving {
  readonly dialog = make("dialog", { role: "alertdialog", class: "leaving", "aria-labelledby": "leaving-title", "aria-describedby": "leaving-lost" });
  private readonly title = make("h2", { id: "leaving-title" });
  private readonly lost = make("p", { id: "leaving-lost" });
  private readonly keep = make("button", { type: "button", class: "primary", autofocus: true, click: () => this.dialog.close() }, "Keep");
  private readonly leave = make("button", { type: "button", click: () => this.dialog.close("leave") }, "Open");
  private asked: AbortController | null = null;

  constructor() {
    this.dialog.append(this.title, this.lost, make("div", { class: "buttons" }, this.keep, this.leave));
  }

  // Whether another mesh is to be opened in the place of one; a newer question takes the place of one that is open.
  ask(open: string, other: string, lost: string): Promise<boolean> {
    this.asked?.abort();
    const asked = (this.asked = new AbortController());
    this.title.textContent = `Open ${other} in place of ${open}?`;
    this.lost.textContent = `${lost} and will be lost.`;
    this.keep.textContent = `Keep ${open}`;
    this.leave.textContent = `Open ${other}`;
    this.dialog.returnValue = "";
    if (!this.dialog.open) this.dialog.showModal();
    return new Promise((resolve) => {
      asked.signal.addEventListener("abort", () => resolve(false));
      this.dialog.addEventListener("close", () => resolve(this.dialog.returnValue === "leave"), { once: true, signal: asked.signal });
    });
  }
}
