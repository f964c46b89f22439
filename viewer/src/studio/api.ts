// Requests to the server, each with the token, and what the server tells.

import type { Completion, PackedScene } from "../format";

export interface Input {
  name: string;
  label: string;
  help: string;
  unit: string;
  allowed: string;
  kind: "choice" | "number" | "text";
  whole: boolean;
  choices: string[];
  default: string;
  minimum: number | null;
  maximum: number | null;
  example: string;
}

export interface Method {
  name: string;
  family: string; // its title, and what its methods do in plain words; those of a family follow each other
  about: string;
  summary: string;
  source: string;
  settings: Input[];
}

export interface Form {
  default: string;
  methods: Method[];
  controls: Input[];
}

export interface Settings {
  method: string;
  parameters: Record<string, string>;
  controls: Record<string, string>;
}

export interface Opened {
  type: "opened";
  name: string;
  suggested: string;
  saves: boolean; // beside the file; a dropped one has no folder
  vertices: number;
  faces: number;
  painted: number; // vertices that are shown, and painted
  notice: string;
  scene: number;
}

// What was done to the whole mesh; the error and the treatment as the command line prints them.
export interface Outcome {
  seconds: number;
  moved: number;
  error: string | null;
  treated_as: string | null;
}

export type Told =
  | { type: "empty" }
  | { type: "opening"; name: string }
  | Opened
  | { type: "unopened"; error: string }
  | { type: "painted"; page: string }
  | { type: "progress"; ticket: string; fraction: number; left: number | null }
  | ({ type: "shown"; ticket: string; scene: number } & ({ coarse: true } | ({ coarse: false } & Outcome)))
  | { type: "cancelled"; ticket: string }
  | { type: "failed"; ticket: string; error: string; parameter?: string };

export interface Recipe {
  command: string;
  python: string;
  painted: string[]; // names of the files that both read, which are written as the result is saved
}

export interface Saved extends Recipe {
  file: string;
  files: { path: string; number: number }[]; // everything that was written, with the numbers by which it is read again
  left_out: string[];
}

export interface Downloaded {
  name: string;
  files: string[]; // in it, where it is a ZIP file
  left_out: string[];
  content: Blob;
}

export class Refused extends Error {
  constructor(
    message: string,
    readonly existing: string[] = [], // names of files that are there, and may be replaced
    readonly status = 0, // of the answer
  ) {
    super(message);
  }
}

const KEY = "cascadenorm-token";

// The token comes in the address, which is never sent, and stays with this tab when the page is loaded again.
export function token(): string | null {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given) {
    sessionStorage.setItem(KEY, given);
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem(KEY);
}

export class Api {
  readonly page = crypto.randomUUID(); // pages of one studio share the mesh and its paint

  constructor(private readonly secret: string) {}

  form(): Promise<Form> {
    return this.json("GET", "form");
  }

  // A scene by its number; null where it is no longer kept, since there are newer ones.
  async scene(number: number): Promise<PackedScene | Completion | null> {
    try {
      return await this.json("GET", `scene/${number}`);
    } catch (error) {
      if (error instanceof Refused && error.status === 404) return null;
      throw error;
    }
  }

  denoise(settings: Settings, ticket: string): Promise<unknown> {
    return this.json("POST", "denoise", { settings, ticket });
  }

  cancel(): Promise<unknown> {
    return this.json("POST", "cancel", {});
  }

  recipe(settings: Settings, name: string): Promise<Recipe> {
    return this.json("POST", "recipe", { settings, name });
  }

  save(settings: Settings, name: string, force: boolean): Promise<Saved> {
    return this.json("POST", "save", { settings, name, force });
  }

  async download(settings: Settings, name: string): Promise<Downloaded> {
    const answer = await this.asked("POST", "download", JSON.stringify({ settings, name }));
    return { ...JSON.parse(decodeURIComponent(answer.headers.get("x-about")!)), content: await answer.blob() };
  }

  // A file that was saved.
  async savedFile(number: number): Promise<Blob> {
    return (await this.asked("GET", `saved/${number}`)).blob();
  }

  paint(codes: Uint8Array<ArrayBuffer>): Promise<unknown> {
    return this.asked("POST", `paint?page=${this.page}`, codes);
  }

  // The paint that the server has of the open mesh, empty without one.
  async keptPaint(): Promise<Uint8Array<ArrayBuffer>> {
    return new Uint8Array(await (await this.asked("GET", "kept-paint")).arrayBuffer());
  }

  // Say that this page is closed. A tab that the browser discards says nothing, and the studio waits for it.
  leave(): void {
    const headers = { authorization: `Bearer ${this.secret}` };
    void fetch("/api/leave", { method: "POST", body: "{}", headers, keepalive: true }).catch(() => undefined);
  }

  // Open one of the files; the others may belong to it.
  async drop(files: File[]): Promise<void> {
    for (const file of files) {
      await file.slice(0, 1).arrayBuffer().catch(() => {
        throw new Refused(`${file.name} cannot be read. If it is a folder, open the files in it.`);
      });
    }
    const { drop } = await this.json<{ drop: number }>("POST", "drop", {});
    for (const file of files) await this.asked("POST", `drop/${drop}?name=${encodeURIComponent(file.name)}`, file);
    await this.json("POST", "open", { drop, names: files.map(({ name }) => name) });
  }

  // Tell what happens, until the server ends.
  async listen(tell: (told: Told) => void): Promise<void> {
    const reader = (await this.asked("GET", "events")).body!.pipeThrough(new TextDecoderStream()).getReader();
    let text = "";
    for (;;) {
      const { done, value } = await reader.read().catch(() => ({ done: true, value: "" })); // it may end amid a part
      if (done) return;
      const parts = (text + value).split("\n\n");
      text = parts.pop()!;
      for (const part of parts) if (part.startsWith("data: ")) tell(JSON.parse(part.slice(6)) as Told);
    }
  }

  private async json<T>(method: string, path: string, content?: object): Promise<T> {
    return (await this.asked(method, path, content && JSON.stringify(content))).json() as Promise<T>;
  }

  private async asked(method: string, path: string, body?: BodyInit): Promise<Response> {
    let answer: Response;
    try {
      answer = await fetch(`/api/${path}`, { method, body, headers: { authorization: `Bearer ${this.secret}` } });
    } catch {
      throw new Refused("The studio has stopped. Start it again.");
    }
    if (answer.ok) return answer;
    const told = (await answer.json().catch(() => ({}))) as { error?: string; existing?: string[] };
    throw new Refused(told.error ?? `The studio answered ${answer.status}.`, told.existing, answer.status);
  }
}
