// The dialog that saves a result, and the two ways to make it again that can be copied.

import { make } from "../dom";
import { Api, Opened, Refused, Settings } from "./api";

export class Saving {
  readonly dialog = make("dialog", { class: "saving", "aria-labelledby": "saving-title" });
  private readonly name = make("input", { type: "text", id: "saving-name", spellcheck: "false", autocomplete: "off" });
  private readonly beside = make("button", { type: "submit" }, "Save");
  private readonly said = make("p", { class: "note", role: "status" });
  private replaces: string[] = []; // names of files that may be replaced, when it is asked for again
  private settings: Settings | null = null;

  constructor(
    private readonly api: Api,
    private readonly saved: (file: string) => void,
  ) {
    const download = make("button", { type: "button", click: () => void this.download() }, "Download");
    const close = make("button", { type: "button", click: () => this.dialog.close() }, "Close");
    this.name.addEventListener("input", () => this.ask([]));
    this.dialog.append(
      make(
        "form",
        { submit: (event: Event) => (event.preventDefault(), void (this.beside.hidden ? this.download() : this.save())) },
        make("h2", { id: "saving-title" }, "Save the result"),
        make("label", { for: "saving-name" }, "File name; its extension selects the format"),
        this.name,
        make("div", { class: "buttons" }, this.beside, download, close),
        this.said,
      ),
    );
  }

  open({ suggested, saves }: Opened): void {
    this.dialog.close(); // it was about another mesh
    this.name.value = suggested;
    this.beside.hidden = !saves;
  }

  show(settings: Settings): void {
    this.settings = settings;
    this.ask([]);
    this.said.replaceChildren();
    this.dialog.showModal();
    this.name.setSelectionRange(0, this.name.value.lastIndexOf("."));
  }

  // A name for what the recipe makes.
  get target(): string {
    return this.name.value;
  }

  private ask(replaces: string[]): void {
    this.replaces = replaces;
    this.beside.textContent = replaces.length ? `Replace ${replaces.join(" and ")}` : "Save beside the input";
  }

  private async save(): Promise<void> {
    this.said.textContent = "Saving…";
    try {
      const { file, left_out } = await this.api.save(this.settings!, this.name.value, this.replaces.length > 0);
      this.done(`Saved as ${file}.`, left_out);
      this.saved(file);
      this.ask([]);
    } catch (error) {
      const existing = error instanceof Refused ? error.existing : [];
      const [verb, them] = existing.length > 1 ? ["exist", "them"] : ["exists", "it"];
      this.said.textContent = existing.length
        ? `${existing.join(" and ")} ${verb} already: choose another name, or replace ${them}.`
        : (error as Error).message;
      this.ask(existing);
    }
  }

  private async download(): Promise<void> {
    this.said.textContent = "Preparing the file…";
    try {
      const { name, files, left_out, content } = await this.api.download(this.settings!, this.name.value);
      const href = URL.createObjectURL(content);
      make("a", { href, download: name }).click();
      setTimeout(() => URL.revokeObjectURL(href), 60_000);
      const holds = files.length > 1 ? `, which holds ${files.slice(0, -1).join(", ")} and ${files[files.length - 1]}` : "";
      this.done(`Downloaded as ${name}${holds}.`, left_out);
      this.saved(this.name.value);
    } catch (error) {
      this.said.textContent = (error as Error).message;
    }
  }

  private done(text: string, leftOut: string[]): void {
    const lost = leftOut.length ? ` The format cannot hold: ${leftOut.join("; ")}.` : " All attributes of the input are kept.";
    this.said.textContent = text + lost;
  }
}
