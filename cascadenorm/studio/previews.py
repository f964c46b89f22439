"""Coarse meshes, for previews."""

from typing import Any, NamedTuple, cast

import numpy as np

from cascadenorm.controls.settings import CONTROLS, Controls, parsed_length
from cascadenorm.mesh import Mesh
from cascadenorm.reports.display import Display, display

COARSE = 1 << 15
"""Faces of a coarse mesh; `auto` takes about a second for it."""


class Coarse(NamedTuple):
    """A mesh with fewer faces, and which vertices and faces of the whole one these stand for."""

    mesh: Mesh
    shown: Display

    def controls(self, controls: Controls, whole: Mesh) -> Controls:
        """Return controls over the whole mesh, given as arrays, over this one; lengths are those on the whole mesh."""
        found: dict[str, Any] = {**controls}
        for name in ("mask", "fixed"):
            if found[name] is not None:
                found[name] = np.asarray(found[name])[self.shown.kept_vertices]
        if found["only"] is not None:
            found["only"] = np.asarray(found["only"])[self.shown.kept_faces]
        for name, setting in CONTROLS.items():
            if setting.kinds == (float, str) and found[name] is not None:
                length, in_edges = parsed_length(name, found[name])
                found[name] = length * whole.mean_edge_length if in_edges else length
        return cast(Controls, found)


def coarse(mesh: Mesh) -> Coarse | None:
    """Return a coarse mesh for previews; None for a mesh that is small itself."""
    if len(mesh.faces) <= 2 * COARSE:
        return None
    shown = display(mesh, most=COARSE)
    return Coarse(Mesh(mesh.vertices[shown.kept_vertices], shown.faces), shown)
