// Progress with the time left, and the outcome.

import { counted, make } from "../dom";
import type { Outcome } from "./api";

const SOON = 0.5; // seconds left that are not worth a number

export class Status {
  readonly element = make("div", { class: "status" });
  private readonly bar = make("progress", { max: 1, value: 0, "aria-label": "Denoising" });
  private readonly said = make("p", { class: "said", role: "status" });
  private readonly failed = make("p", { class: "failed", role: "alert" });
  private readonly noted = make("p", { class: "noted" });
  private readonly found = make("dl", { class: "keys found" });
  private readonly text = make("pre", {}, make("code"));
  private readonly work: HTMLElement;
  private readonly cancel: HTMLButtonElement;
  private readonly again: HTMLButtonElement;
  private what = "";
  private cancelling = false; // work was cancelled, and may go on for seconds
  private restartable = false; // it was cancelled, and can be started again
  private readonly opening = make("p", { class: "said", role: "status" });

  constructor(cancel: () => void, again: () => void) {
    const end = () => {
      this.cancelling = true;
      this.said.textContent = "Cancelling…";
      cancel();
    };
    this.cancel = make("button", { type: "button", click: end }, "Cancel");
    this.work = make("div", { class: "row" }, this.bar, this.cancel);
    this.again = make("button", { type: "button", hidden: true, click: again }, "Denoise");
    this.element.append(this.work, this.said, this.opening, this.failed, this.again, this.found, this.noted, this.text);
    this.work.hidden = this.failed.hidden = this.noted.hidden = this.text.hidden = true;
  }

  begin(): void {
    this.what = "Denoising";
    this.found.replaceChildren();
    const focused = this.again === document.activeElement;
    this.cancelling = false;
    this.say("Denoising…");
    this.bar.value = 0;
    this.work.hidden = false;
    if (focused) this.cancel.focus();
  }

  // A coarse mesh is shown, and the whole one is on its way.
  coarse(): void {
    this.what = "This is a coarse preview. Denoising the whole mesh";
    if (!this.cancelling) this.said.textContent = `${this.what}…`;
    this.bar.value = 0;
  }

  progress(fraction: number, left: number | null): void {
    this.bar.value = fraction;
    if (this.cancelling) return;
    this.said.textContent = left === null || left < SOON ? `${this.what}…` : `${this.what}: about ${duration(left)} left.`;
  }

  // What was done, with the lines that the command line prints.
  done({ seconds, moved, error, treated_as }: Outcome): void {
    this.say(`Denoised in ${duration(seconds)}; ${counted(moved, "vertex", "vertices")} moved.`);
    const rows = [["Kind of error", error], ["Treated as", treated_as]].filter(([, text]) => text);
    this.found.replaceChildren(...rows.flatMap(([name, text]) => [make("dt", {}, name!), make("dd", {}, text!)]));
  }

  // Say why there is no result, which can be asked for.
  cancelled(why: string): void {
    const focused = this.cancel === document.activeElement;
    if (this.failed.hidden) this.say(this.opens ? "" : why);
    this.work.hidden = true;
    this.offer(true);
    if (focused) this.again.focus();
  }

  // Say what is being opened until the work is over, whatever else is said meanwhile.
  async open(text: string, work: () => Promise<unknown>): Promise<void> {
    this.failed.hidden = true;
    this.opening.textContent = text;
    this.offer(this.restartable);
    try {
      await work();
    } finally {
      if (this.opening.textContent === text) this.opening.textContent = "";
      this.offer(this.restartable);
    }
  }

  private get opens(): boolean {
    return this.opening.textContent !== "";
  }

  private offer(restartable: boolean): void {
    this.restartable = restartable;
    this.again.hidden = !restartable || this.opens;
  }

  say(text: string): void {
    this.said.textContent = text;
    this.work.hidden = this.failed.hidden = this.text.hidden = true;
    this.offer(false);
  }

  fail(text: string): void {
    const { restartable } = this;
    this.say("");
    this.offer(restartable);
    this.failed.hidden = false;
    this.failed.textContent = text;
  }

  // What holds for the open file.
  notice(text: string): void {
    this.noted.hidden = text === "";
    this.noted.textContent = text;
  }

  copied(text: string, code: string): void {
    this.say(text);
    this.text.hidden = false;
    this.text.firstElementChild!.textContent = code;
  }
}

function duration(seconds: number): string {
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  return seconds < 100 ? `${Math.round(seconds)} s` : `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;
}
