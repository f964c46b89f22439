// The viewer of a report, which replaces the still picture where scripts and WebGL run.

import { make } from "./dom";
import { PackedScene } from "./format";
import { modelOf } from "./model";
import { Viewer } from "./viewer";

export { modelOf, Viewer };

async function start(root: HTMLElement, data: HTMLElement): Promise<void> {
  const note = make("p", { class: "note", role: "status" }, "Opening the meshes…");
  root.prepend(note);
  try {
    const model = await modelOf(JSON.parse(data.textContent!) as PackedScene);
    data.remove();
    new Viewer(root, model, { linked: !document.body.classList.contains("frame") }); // a frame has no address of its own
    root.dataset.state = "ready";
  } catch (error) {
    note.textContent = "The 3-D viewer needs WebGL 2, which this browser does not offer. The picture and the text are complete.";
    root.dataset.state = "still";
    root.dataset.reason = String(error);
  }
}

const data = document.getElementById("scene");
if (data) void start(document.getElementById("viewer")!, data);
