// The dialog that saves a result, and the files that were saved.

import { make } from "../dom";
import { Api, Opened, Refused, Settings } from "./api";

export class Saving {
  readonly dialog = make("dialog", { class: "saving", "aria-labelledby": "saving-title" });
  readonly kept = make("div"); // holds the list of saved files while the dialog is closed
  private readonly name = make("input", { type: "text", id: "saving-name", spellcheck: "false", autocomplete: "off" });
  private readonly beside = make("button", { type: "submit" }, "Save");
  private readonly download = make("button", { type: "button", click: () => void this.downloaded() }, "Download");
  private readonly said = make("p", { class: "note", role: "status" });
  private readonly files = make("ul");
  private readonly missing = make("p", { class: "note", role: "status" }); // a file of the list
  private readonly listed = make("section", { class: "saved-files", hidden: true }, make("h3", {}, "Saved files"), this.files, this.missing);
  private replaces: string[] = []; // names of files that may be replaced, when it is asked for again
  private settings: Settings | null = null;

  constructor(
    private readonly api: Api,
    private readonly saved: (file: string) => void,
  ) {
    const close = make("button", { type: "button", click: () => this.dialog.close() }, "Close");
    this.name.addEventListener("input", () => this.ask([]));
    this.dialog.append(
      make(
        "form",
        { submit: (event: Event) => (event.preventDefault(), void (this.beside.hidden ? this.downloaded() : this.save())) },
        make("h2", { id: "saving-title" }, "Save the result"),
        make("label", { for: "saving-name" }, "File name; its extension selects the format"),
        this.name,
        make("div", { class: "buttons" }, this.beside, this.download, close),
        this.said,
      ),
    );
    this.dialog.addEventListener("close", () => this.kept.append(this.listed));
  }

  open({ suggested, saves }: Opened): void {
    this.dialog.close(); // it was about another mesh
    this.name.value = suggested;
    this.beside.hidden = !saves;
    this.beside.classList.toggle("primary", saves);
    this.download.classList.toggle("primary", !saves);
  }

  show(settings: Settings): void {
    this.settings = settings;
    this.ask([]);
    this.said.replaceChildren();
    this.dialog.append(this.listed);
    this.dialog.showModal();
    this.name.setSelectionRange(0, this.name.value.lastIndexOf("."));
  }

  // A name for what the recipe makes.
  get target(): string {
    return this.name.value.trim();
  }

  private ask(replaces: string[]): void {
    this.replaces = replaces;
    this.beside.textContent = replaces.length ? `Replace ${replaces.join(" and ")}` : "Save beside the input";
  }

  private async save(): Promise<void> {
    this.said.textContent = "Saving…";
    try {
      const { file, files, left_out } = await this.api.save(this.settings!, this.target, this.replaces.length > 0);
      this.done(`Saved as ${file}.`, left_out);
      for (const { path, number } of files) this.list(path, baseName(path), "Download a copy", () => this.api.savedFile(number));
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

  private async downloaded(): Promise<void> {
    this.said.textContent = "Preparing the file…";
    try {
      const { name, files, left_out, content } = await this.api.download(this.settings!, this.target);
      give(name, content);
      const holds = files.length > 1 ? `, which holds ${files.slice(0, -1).join(", ")} and ${files[files.length - 1]}` : "";
      this.done(`Downloaded as ${name}${holds}.`, left_out);
      this.list(`${name}, in the browser's downloads`, name, "Download again", async () => content);
      this.saved(this.target);
    } catch (error) {
      this.said.textContent = (error as Error).message;
    }
  }

  // A line for a file that was saved, the latest first, with a link to its content.
  private list(path: string, name: string, action: string, content: () => Promise<Blob>): void {
    for (const item of this.files.children) if ((item as HTMLElement).dataset.path === path) item.remove();
    const follow = async (event: Event) => {
      event.preventDefault();
      this.missing.textContent = "";
      try {
        give(name, await content());
      } catch (error) {
        this.missing.textContent = (error as Error).message;
      }
    };
    const link = make("a", { href: "#", click: (event: Event) => void follow(event) }, action);
    this.files.prepend(make("li", { "data-path": path }, make("code", {}, path), " ", link));
    this.listed.hidden = false;
  }

  private done(text: string, leftOut: string[]): void {
    const lost = leftOut.length ? ` The format cannot hold: ${leftOut.join("; ")}.` : " All attributes of the input are kept.";
    this.said.textContent = text + lost;
  }
}

function baseName(path: string): string {
  return path.slice(Math.max(path.lastIndexOf("/"), path.lastIndexOf("\\")) + 1);
}

// Hand a file to the browser.
function give(name: string, content: Blob): void {
  const href = URL.createObjectURL(content);
  make("a", { href, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60_000);
}
