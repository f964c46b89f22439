// The page: what is open, what is asked for, what is shown.

import { make } from "../dom";
import type { PackedScene } from "../format";
import { Api, Form, Opened, Settings, Told } from "./api";
import { Dropping } from "./dropping";
import { SettingsForm } from "./form";
import { Saving } from "./saving";
import { Status } from "./status";
import { modelOf, Viewer } from "./viewer";

const PAUSE = 150; // milliseconds without a change, after which an answer is asked for

export class Studio {
  private readonly title = make("h1", {}, "cascadenorm studio");
  private readonly counts = make("p", { class: "counts" });
  private readonly viewerRoot = make("div", { id: "viewer" });
  private readonly status: Status;
  private readonly form: SettingsForm;
  private readonly saving: Saving;
  private readonly dropping: Dropping;
  private readonly save = make("button", { type: "button", disabled: true, click: () => this.saving.show(this.shown!) }, "Save…");
  private readonly copies: HTMLButtonElement[];
  private viewer: Viewer | null = null;
  private opened: Opened | null = null;
  private shown: Settings | null = null; // what made the mesh that is shown
  private asked: { ticket: string; settings: Settings } | null = null;
  private timer = 0;
  private turn = 0; // of the scenes: one that comes late is not shown
  private unsaved = false;

  constructor(
    private readonly root: HTMLElement,
    private readonly api: Api,
    form: Form,
  ) {
    this.status = new Status(() => void this.attempt(() => api.cancel()));
    this.form = new SettingsForm(form, () => this.changing(), () => {});
    this.saving = new Saving(api, () => (this.unsaved = false));
    this.dropping = new Dropping((files) => this.attempt(() => api.drop(files), "Opening the mesh…"));
    this.copies = [
      make("button", { type: "button", disabled: true, click: () => void this.copy("command") }, "Copy as command line"),
      make("button", { type: "button", disabled: true, click: () => void this.copy("python") }, "Copy as Python"),
    ];
    root.replaceChildren(
      make(
        "header",
        { class: "bar" },
        make("div", {}, this.title, this.counts),
        make("div", { class: "buttons" }, this.dropping.button, this.save),
      ),
      make(
        "main",
        { class: "work" },
        make(
          "section",
          { class: "side", "aria-label": "Denoise" },
          this.form.element,
          this.status.element,
          make("div", { class: "buttons" }, ...this.copies),
        ),
        make("section", { class: "view", "aria-label": "Mesh" }, this.viewerRoot, this.dropping.zone),
      ),
      this.saving.dialog,
    );
    addEventListener("beforeunload", (event) => this.unsaved && event.preventDefault());
    root.dataset.state = "empty";
  }

  hear(told: Told): void {
    if (told.type === "opened") void this.attempt(() => this.open(told));
    else if (told.type === "unopened") this.status.fail(told.error);
    else if (told.ticket !== this.asked?.ticket) return;
    else if (told.type === "progress") this.status.progress(told.fraction, told.left);
    else if (told.type === "shown") void this.attempt(() => this.answer(told));
    else if (told.type === "failed") this.status.fail(told.error);
    else this.status.say("Cancelled.");
  }

  end(): void {
    this.unsaved = false;
    this.status.fail("The studio has ended: start it again.");
    this.root.dataset.state = "ended";
  }

  private async open(opened: Opened): Promise<void> {
    this.asked = this.shown = null;
    this.root.dataset.state = "opening";
    this.status.say("Opening the mesh…");
    this.opened = opened;
    this.unsaved = false;
    this.title.textContent = document.title = opened.name;
    this.counts.textContent = `${opened.faces.toLocaleString("en")} faces, ${opened.vertices.toLocaleString("en")} vertices`;
    this.status.notice(opened.notice && `${opened.notice}; these stay as they are.`);
    this.saving.open(opened);
    this.offer();
    await this.draw(opened.scene, false);
    this.ask();
  }

  private changing(): void {
    clearTimeout(this.timer);
    if (this.opened) this.timer = window.setTimeout(() => this.ask(), PAUSE);
  }

  private ask(): void {
    void this.attempt(async () => {
      const { settings } = this.form;
      this.root.dataset.state = "working";
      this.status.begin();
      this.asked = { ticket: crypto.randomUUID(), settings: structuredClone(settings) };
      await this.api.denoise(settings, this.asked.ticket);
    });
  }

  private async answer(told: Told & { type: "shown" }): Promise<void> {
    const { settings } = this.asked!;
    await this.draw(told.scene, true);
    if (told.coarse) {
      this.status.coarse();
      return;
    }
    if (this.asked?.ticket !== told.ticket) return;
    this.shown = settings;
    this.unsaved = true;
    this.status.done(told.seconds!, told.moved!);
    this.offer();
    this.root.dataset.state = "shown";
  }

  private async draw(scene: number, samePlace: boolean): Promise<void> {
    const turn = ++this.turn;
    const model = await modelOf((await this.api.scene(scene)) as PackedScene);
    if (turn !== this.turn) return;
    if (this.viewer) this.viewer.show(model, samePlace);
    else this.viewer = new Viewer(this.viewerRoot, model, false);
    this.dropping.zone.hidden = true;
  }

  private offer(): void {
    for (const button of [this.save, ...this.copies]) button.disabled = this.shown === null;
  }

  private async copy(kind: "command" | "python"): Promise<void> {
    await this.attempt(async () => {
      const text = (await this.api.recipe(this.shown!, this.saving.target))[kind];
      try {
        await navigator.clipboard.writeText(text);
        this.status.copied("Copied: ", text);
      } catch {
        this.status.copied("Copy this: ", text);
      }
    });
  }

  private async attempt(work: () => Promise<unknown>, saying = ""): Promise<void> {
    if (saying) this.status.say(saying);
    try {
      await work();
    } catch (error) {
      this.status.fail((error as Error).message);
    }
  }
}
