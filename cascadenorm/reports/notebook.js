// The cell of a notebook: the viewer in a frame of its own, so that neither's styles, keys and address meet the other's.

function render({ model, el }) {
  const frame = document.createElement("iframe");
  frame.title = "Meshes in a 3-D viewer";
  frame.style.cssText = "width: 100%; border: 0; display: block";
  frame.style.height = `${model.get("height")}px`;
  frame.srcdoc = model.get("page");
  el.replaceChildren(frame);
}

export default { render };
