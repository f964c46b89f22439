// The page: what is open, what is asked for, what is shown.

import { counted, make } from "../dom";
import type { Model, Surface } from "../model";
import { Api, Form, Opened, Settings, Told } from "./api";
import { Brush } from "./brush";
import { Dropping } from "./dropping";
import { SettingsForm, Values } from "./form";
import { History } from "./history";
import { Leaving } from "./leaving";
import { Saving } from "./saving";
import { Status } from "./status";
import { modelOf, Viewer } from "./viewer";

const PAUSE = 150; // milliseconds without a change, after which an answer is asked for

interface Choices {
  values: Values;
  codes: Uint8Array<ArrayBuffer>; // of the paint
}

export class Studio {
  private readonly title = make("h1", {}, "cascadenorm studio");
  private readonly counts = make("p", { class: "counts" });
  private readonly viewerRoot = make("div", { id: "viewer" });
  private readonly status: Status;
  private readonly form: SettingsForm;
  private readonly saving: Saving;
  private readonly dropping: Dropping;
  private readonly leaving = new Leaving();
  private readonly save = make("button", { type: "button", class: "primary", disabled: true, click: () => this.saving.show(this.shown!) }, "Save…");
  private readonly copies: HTMLButtonElement[];
  private readonly back = make("button", { type: "button", disabled: true, title: "Ctrl+Z", click: () => this.go(true) }, "Undo");
  private readonly forth = make("button", { type: "button", disabled: true, title: "Ctrl+Shift+Z", click: () => this.go(false) }, "Redo");
  private readonly brush = new Brush(() => (this.remember(), this.changing()));
  private readonly history = new History<Choices>();
  private viewer: Viewer | null = null;
  private opened: Opened | null = null;
  private shown: Settings | null = null; // what made the mesh that is shown
  private asked: { ticket: string; settings: Settings } | null = null;
  private sent: Uint8Array | null = null; // the paint that the server has
  private timer = 0;
  private alone: Model | null = null; // the open mesh without a result
  private result: Surface | null = null;
  private coarse = false; // whether it is a preview
  private savedAs = ""; // the file that was written last
  private turn = 0; // of the scenes: one that comes late is not shown
  private unsaved = false; // the result
  private savedPaint: Uint8Array | null = null;

  constructor(
    private readonly root: HTMLElement,
    private readonly api: Api,
    form: Form,
  ) {
    this.status = new Status(
      () => void this.attempt(() => api.cancel()),
      () => this.ask(),
    );
    this.form = new SettingsForm(
      form,
      () => this.changing(),
      () => this.remember(),
    );
    this.saving = new Saving(api, (file) => this.saved(file));
    this.dropping = new Dropping((files) => void this.replace(files));
    this.copies = [
      make("button", { type: "button", disabled: true, click: () => void this.copy("command") }, "Copy as command line"),
      make("button", { type: "button", disabled: true, click: () => void this.copy("python") }, "Copy as Python"),
    ];
    root.replaceChildren(
      make(
        "header",
        { class: "bar" },
        make("div", {}, this.title, this.counts),
        make("div", { class: "buttons" }, this.back, this.forth, this.dropping.button, this.save),
      ),
      make(
        "main",
        { class: "work" },
        make(
          "section",
          { class: "side", "aria-label": "Denoise" },
          this.form.element,
          this.brush.element,
          this.status.element,
          make("div", { class: "buttons" }, ...this.copies),
          this.saving.kept,
        ),
        make("section", { class: "view", "aria-label": "Mesh" }, this.viewerRoot, this.dropping.zone),
      ),
      this.saving.dialog,
      this.leaving.dialog,
    );
    addEventListener("beforeunload", (event) => this.lost && event.preventDefault());
    addEventListener("pagehide", () => this.api.leave());
    addEventListener("keydown", (event) => this.key(event));
    this.brush.element.hidden = true;
    root.dataset.state = "empty";
  }

  hear(told: Told): void {
    if (told.type === "empty") this.dropping.zone.hidden = false;
    else if (told.type === "opening") this.opening(told.name);
    else if (told.type === "opened") void this.attempt(() => this.open(told));
    else if (told.type === "unopened") this.unopened(told.error);
    else if (told.type === "painted") void (told.page === this.api.page || this.attempt(() => this.repainted()));
    else if (told.ticket !== this.asked?.ticket) return;
    else if (told.type === "progress") this.status.progress(told.fraction, told.left);
    else if (told.type === "shown") void this.attempt(() => this.answer(told));
    else if (told.type === "failed") this.failed(told.error, told.parameter);
    else this.cancelled();
  }

  end(): void {
    this.unsaved = false;
    this.savedPaint = this.brush.codes;
    this.status.fail("The studio has stopped. Start it again.");
    this.root.dataset.state = "ended";
  }

  // The file that the studio was started with is being read.
  private opening(name: string): void {
    this.root.dataset.state = "opening";
    this.status.say(`Opening ${name}…`);
  }

  private unopened(error: string): void {
    this.dropping.zone.hidden = this.viewer !== null;
    this.root.dataset.state = "empty";
    this.status.fail(error);
  }

  private async open(opened: Opened): Promise<void> {
    this.asked = this.shown = this.sent = this.alone = null;
    this.result = null;
    this.coarse = false;
    this.turn++; // what is still on its way is of another mesh
    this.root.dataset.state = "opening";
    this.dropping.zone.hidden = true;
    this.status.say("Opening the mesh…");
    this.opened = opened;
    this.unsaved = false;
    this.savedAs = "";
    this.title.textContent = document.title = opened.name;
    this.counts.textContent = `${counted(opened.faces, "face", "faces")}, ${counted(opened.vertices, "vertex", "vertices")}`;
    this.status.notice(opened.notice && `${opened.notice}; these stay unchanged.`);
    this.savedPaint = null;
    this.leaving.dialog.close();
    this.saving.open(opened);
    this.brush.open(opened.painted);
    const kept = await this.api.keptPaint(); // this tab may have been discarded, or loaded again
    if (this.opened !== opened) return;
    if (kept.length === opened.painted) this.brush.show(kept);
    this.brush.element.hidden = false;
    this.history.begin(this.choices);
    this.offer();
    if (await this.draw(opened.scene, false)) this.ask();
  }

  // Open files, unless work would be lost that the user wants to keep.
  private async replace(files: File[]): Promise<void> {
    const { lost, opened } = this;
    const other = files.length > 1 ? `${files.length} files` : files[0].name;
    if (lost && !(await this.leaving.ask(opened!.name, other, lost))) return;
    await this.attempt(() => this.status.open(`Opening ${other}…`, () => this.api.drop(files)));
  }

  // What is not saved, in words.
  private get lost(): string {
    const { codes } = this.brush;
    const painted = codes !== this.savedPaint && codes.some((code) => code !== 0);
    if (painted) return this.unsaved ? "The paint and the result are not saved" : "The paint is not saved";
    return this.unsaved ? "The result is not saved" : "";
  }

  private saved(file: string): void {
    this.unsaved = false;
    this.savedPaint = this.brush.codes;
    this.savedAs = file;
    if (this.result) this.result.file = file;
  }

  private changing(): void {
    clearTimeout(this.timer);
    if (this.opened) this.timer = window.setTimeout(() => this.ask(), PAUSE);
  }

  private get choices(): Choices {
    return { values: structuredClone(this.form.values), codes: this.brush.codes };
  }

  private remember(): void {
    if (this.opened) this.history.push(this.choices);
    this.offer();
  }

  // Go back to the choices before, or forth again.
  private go(back: boolean): void {
    if (!(back ? this.history.canUndo : this.history.canRedo)) return;
    const { values, codes } = back ? this.history.undo() : this.history.redo();
    this.form.show(values);
    this.brush.show(codes);
    this.offer();
    this.changing();
  }

  private key(event: KeyboardEvent): void {
    const typing = event.target instanceof HTMLInputElement && /text|number/.test(event.target.type);
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || typing || this.saving.dialog.open) return;
    event.preventDefault();
    this.go(!event.shiftKey);
  }

  private ask(): void {
    void this.attempt(async () => {
      const asked = { ticket: crypto.randomUUID(), settings: structuredClone(this.form.settings) };
      const { codes } = this.brush;
      this.asked = asked;
      this.shown = null; // what is saved is what is shown
      this.offer();
      this.root.dataset.state = "working";
      this.status.begin();
      this.form.mark("");
      const painted = codes !== this.sent; // at first too: the page may have been loaded again
      if (painted) await this.api.paint(codes);
      if (painted) this.sent = codes;
      if (this.asked === asked) await this.api.denoise(asked.settings, asked.ticket);
    });
  }

  private async answer(told: Told & { type: "shown" }): Promise<void> {
    const { settings } = this.asked!;
    const drawn = await this.draw(told.scene, true);
    if (this.asked?.ticket !== told.ticket) return;
    if (drawn) this.coarse = told.coarse;
    if (told.coarse) {
      if (drawn) this.status.coarse();
      return;
    }
    if (!drawn) {
      this.cancelled(); // another page has asked for newer scenes
      return;
    }
    this.shown = settings;
    this.unsaved = true;
    this.status.done(told);
    this.offer();
    this.root.dataset.state = "shown";
    this.root.dataset.answers = String(Number(this.root.dataset.answers ?? 0) + 1);
  }

  // Another page has changed the paint, which all results have.
  private async repainted(): Promise<void> {
    const codes = await this.api.keptPaint();
    if (codes.length !== this.brush.codes.length) return; // of another mesh, which is opened next
    this.sent = codes;
    this.asked = this.shown = null;
    this.saving.dialog.close();
    this.brush.show(codes);
    this.remember();
    this.status.say("");
    this.status.cancelled("Another page of this studio has changed the paint.");
  }

  private cancelled(): void {
    const shown = this.coarse ? "A coarse preview is shown." : "The result shown was made with other settings.";
    this.status.cancelled(this.result ? `Cancelled. ${shown}` : "Cancelled.");
  }

  private failed(error: string, parameter = ""): void {
    this.status.fail(error);
    this.form.mark(parameter);
    this.root.dataset.state = "failed";
  }

  // Draw a scene, unless there is a newer one; whether it was drawn.
  private async draw(scene: number, samePlace: boolean): Promise<boolean> {
    const turn = ++this.turn;
    const packed = await this.api.scene(scene);
    if (packed === null || turn !== this.turn) return false;
    const model = await modelOf(packed, this.alone ?? undefined);
    if (turn !== this.turn) return false;
    this.alone ??= { ...model, fields: [...model.fields] };
    this.result = model.surfaces[1] ?? null;
    if (this.result && this.savedAs) this.result.file = this.savedAs;
    this.brush.paintOn(model);
    if (this.viewer) this.viewer.show(model, samePlace);
    else this.viewer = new Viewer(this.viewerRoot, model, { linked: false, unsaved: () => this.unsaved });
    this.brush.use(this.viewer);
    return true;
  }

  private offer(): void {
    for (const button of [this.save, ...this.copies]) button.disabled = this.shown === null;
    this.back.disabled = !this.opened || !this.history.canUndo;
    this.forth.disabled = !this.opened || !this.history.canRedo;
  }

  private async copy(kind: "command" | "python"): Promise<void> {
    await this.attempt(async () => {
      const { [kind]: text, painted } = await this.api.recipe(this.shown!, this.saving.target);
      const how = this.opened!.saves ? "save" : "download";
      const needs = painted.length ? ` It reads ${painted.join(" and ")}: ${how} the result first, which includes the paint.` : "";
      try {
        await navigator.clipboard.writeText(text);
        this.status.copied(`Copied.${needs}`, text);
      } catch {
        this.status.copied(`Copy this.${needs}`, text);
      }
    });
  }

  private async attempt(work: () => Promise<unknown>): Promise<void> {
    try {
      await work();
    } catch (error) {
      this.status.fail((error as Error).message);
    }
  }
}
