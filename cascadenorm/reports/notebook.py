"""Meshes in notebooks: the viewer of reports in a cell, and a still picture where scripts do not run."""

from base64 import b64encode
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from cascadenorm.errors import MissingDependencyError, ParameterError
from cascadenorm.geometry.fields import QUANTITIES, Field, Quantity
from cascadenorm.mesh import Mesh, MeshError, scaled_alike
from cascadenorm.render import HeatMap, inline_row, montage, pixels, png, render
from cascadenorm.reports.given import Given, given, scaled_meshes
from cascadenorm.reports.page import frame_page
from cascadenorm.reports.scene import viewer_scene
from cascadenorm.reports.writing import drawn

if TYPE_CHECKING:
    from anywidget import AnyWidget

OWN = "values"  # name of the values that a caller gives
VIEW_PICTURE, MESH_PICTURE = 420, 280  # size of each still picture of a view, and of that of a mesh, in pixels
MOST_FACES_IN_CELL = 300_000  # largest number of faces for which a cell that shows a mesh draws a picture


def view(
    mesh: Any, other: Any = None, *, truth: Any = None, values: str | ArrayLike | None = None, height: int = 520
) -> "AnyWidget":
    """Show a mesh, or two and the true mesh, in an interactive 3-D viewer in a notebook cell.

    The viewer is that of reports: split screen, side by side, heat maps, and the values of a clicked face. Where
    scripts do not run, the cell holds a still picture.

    Parameters
    ----------
    mesh, other, truth
        Meshes before and after denoising, and the true mesh, of any kind that `denoise` accepts. All but the first are
        optional.
    values
        Quantity that is coloured at first: "angle", "displacement" or "normal-displacement" (with `other`),
        "normal-error" or "distance" (with `truth`), "noise" or "curvature"; or an array of your own values, one for
        each vertex or each face, NaN where there is none. It is shown on every mesh that has as many.
    height
        Height of the cell in pixels.

    Returns
    -------
    A widget, for JupyterLab, VS Code, Colab and others

    Raises
    ------
    ReadError, MeshError
        A mesh cannot be read or is invalid.
    ParameterError
        The values do not exist, need another mesh, or match neither the vertices nor the faces in number.
    MissingDependencyError
        Anywidget is not installed.
    """
    widget = _widget()
    keys = ("mesh",) if other is None and truth is None else ("before", "after", "truth")
    sources = zip(keys, (mesh, other, truth), strict=False)
    meshes = [given(key, source) for key, source in sources if source is not None or key == keys[0]]
    color, own = _values(meshes, values)
    alike = scaled_meshes(meshes)
    packed = viewer_scene(meshes, (), own=own, meshes=alike)
    if color and all(field["name"] != color for field in packed["fields"]):
        against = "`other`, with the same faces," if QUANTITIES[color].against == "input" else "`truth`"
        raise ParameterError(f"{color} compares a mesh with another one", hint=f"give {against} as well")
    maps = {}
    if own is not None:
        maps = {key: HeatMap(v, own.quantity.at, own.limits, own.quantity.signed) for key, v in own.values.items()}
    panels = drawn(meshes, alike, VIEW_PICTURE, maps)
    caption = f"Meshes: {', '.join(one.label.lower() for one in meshes)}"
    page = frame_page(packed, inline_row(panels, caption), caption, color=color)
    return widget(page=page, picture=png(pixels(montage([panels]))), height=height)


def described(mesh: Mesh) -> str:
    """Describe a mesh in HTML, with a picture if the mesh is not too large."""
    words = (
        f"{len(mesh.vertices):,} vertices, {len(mesh.faces):,} faces, mean edge length {mesh.mean_edge_length:.4g}, "
        f"bounding box {' × '.join(f'{side:.4g}' for side in np.ptp(mesh.vertices, axis=0))}"
    )
    picture = ""
    if len(mesh.faces) <= MOST_FACES_IN_CELL:
        with suppress(MeshError):
            (scaled,) = scaled_alike(mesh)
            data = b64encode(png(render(scaled, size=(MESH_PICTURE, MESH_PICTURE), transparent=True))).decode("ascii")
            picture = f'<img src="data:image/png;base64,{data}" alt="The mesh" width="{MESH_PICTURE}">'
    return f"<figure>{picture}<figcaption>{escape(words)}</figcaption></figure>"


def _values(meshes: Sequence[Given], values: str | ArrayLike | None) -> tuple[str, Field | None]:
    """Return the quantity that is shown first, and the values given by the caller."""
    if values is None:
        return "", None
    if isinstance(values, str):
        if values not in QUANTITIES:
            raise ParameterError(f"is {values!r}; it must be one of {', '.join(QUANTITIES)}", parameter="values")
        return values, None
    try:
        numbers = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise ParameterError("are not an array of real numbers", parameter="values") from None
    counts = {one.key: (len(one.mesh.vertices), len(one.mesh.faces)) for one in meshes}
    for number, at in enumerate(("vertex", "face")):
        there = [key for key, count in counts.items() if numbers.shape == (count[number],)]
        if there:
            signed = bool(np.nanmin(numbers, initial=0.0) < 0)
            quantity = Quantity("Values", "", at, signed)  # type: ignore[arg-type]
            return OWN, Field(OWN, dict.fromkeys(there, numbers), quantity)
    sizes = ", ".join(f"{vertices:,} vertices and {faces:,} faces" for vertices, faces in counts.values())
    raise ParameterError(f"have shape {numbers.shape}; the mesh has {sizes}", parameter="values")


@cache
def _widget() -> "type[AnyWidget]":
    """Return the class of the widget, created on first use. Raises MissingDependencyError without anywidget."""
    try:
        import anywidget
        import traitlets
    except ImportError:
        raise MissingDependencyError("view", package="anywidget", extra="notebook") from None

    class View(anywidget.AnyWidget):  # type: ignore[misc]
        """A cell with a page in a frame, and a picture for where scripts do not run."""

        _esm = files("cascadenorm.reports").joinpath("notebook.js").read_text(encoding="utf-8")
        page = traitlets.Unicode().tag(sync=True)
        height = traitlets.Int(520).tag(sync=True)
        picture = traitlets.Bytes()

        def _repr_mimebundle_(self, **settings: Any) -> Any:
            data, about = super()._repr_mimebundle_(**settings)
            return {**data, "image/png": b64encode(self.picture).decode("ascii")}, about

    return View
