"""Coarse meshes, for previews."""

from typing import Any, NamedTuple, cast

import numpy as np

from cascadenorm.controls.settings import CONTROLS, Controls, parsed_length
from cascadenorm.mesh import Mesh
from cascadenorm.reports.display import Display, display

COARSE = 1 << 15
"""Number of faces of a coarse mesh, which `auto` denoises in about a second."""


class Coarse(NamedTuple):
    """A decimated mesh, with the vertices and faces of the whole mesh that it keeps."""

    mesh: Mesh
    shown: Display

    def controls(self, controls: Controls, whole: Mesh) -> Controls:
        """Convert controls for the whole mesh, given as arrays, to this mesh; lengths keep their values."""
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
    """Return a coarse mesh for previews; None if the mesh is small enough itself."""
    if len(mesh.faces) <= 2 * COARSE:
        return None
    shown = display(mesh, most=COARSE)
    return Coarse(Mesh(mesh.vertices[shown.kept_vertices], shown.faces), shown)
