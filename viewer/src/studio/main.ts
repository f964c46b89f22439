// The studio: a form that asks the server, and the viewer that shows its answers.

import { make } from "../dom";
import { Api, token } from "./api";
import { Studio } from "./studio";

async function start(root: HTMLElement): Promise<void> {
  const secret = token();
  if (!secret) throw new Error("Open the address that the studio printed. It contains a token that the studio requires.");
  const api = new Api(secret);
  const studio = new Studio(root, api, await api.form());
  await api.listen((told) => studio.hear(told));
  studio.end();
}

const root = document.getElementById("studio")!;
start(root).catch((error: Error) => {
  root.querySelector(".starting")?.remove();
  root.append(make("p", { class: "ended", role: "alert" }, error.message));
  root.dataset.state = "ended";
});
