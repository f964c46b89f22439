"""Measure the gain from smooth boundaries and creases: python -m benchmarks.accuracy.controls [--record]

The figures are shown in benchmarks/controls.md. Noise is in mean edge lengths, in all directions.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import cascadenorm as cn
from benchmarks import results
from cascadenorm.geometry.metrics import measure
from cascadenorm.mesh import Mesh

sys.path.append(str(Path(__file__).parents[2] / "tests" / "helpers"))

from shapes import cube, grid, noisy

METHODS = ("auto", "bilateral-normal", "laplacian")
STEPS = 30  # edges along a side
LEVELS = (0.1, 0.2)
BOUNDARIES = ("free", "smooth")
ANGLE = 40  # degrees from which on an edge is a crease


def main(arguments: Sequence[str] | None = None) -> None:
    """Denoise a flat square and a cube with each control."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    results.add_option(parser, "controls")
    options = parser.parse_args(arguments)
    results.report(options.record, measured(), table)


def measured() -> dict[str, Any]:
    """Return the errors of each method at each level of noise, with each setting."""
    flat, box = grid(STEPS, STEPS), cube(STEPS)
    edges = sharp_edges(box)
    boundaries, creases = [], []
    for level in LEVELS:
        rough, rough_box = noisy(flat, level), noisy(box, level)
        for name in METHODS:
            by_boundary = [cn.denoise(rough, method=name, boundary=kind) for kind in BOUNDARIES]
            by_crease = [cn.denoise(rough_box, method=name, creases=given) for given in (None, edges, ANGLE)]
            boundaries.append([name, level, *map(boundary_error, by_boundary)])
            creases.append([name, level, *(measure(mesh, box).normal_error_deg for mesh in by_crease)])
    return {"boundaries": boundaries, "creases": creases}


def boundary_error(mesh: Mesh) -> float:
    """Return the mean distance of the boundary of a denoised grid of unit squares from its outline, in the plane."""
    x, y = mesh.vertices[mesh.topology.boundary_vertices, :2].T
    return float(np.mean(np.min(np.abs([x, y, x - STEPS, y - STEPS]), axis=0)))


def sharp_edges(mesh: Mesh) -> np.ndarray:
    """Return the vertices of the edges of a cube, (k, 2)."""
    pairs = mesh.topology.edge_faces.indices.reshape(-1, 2)
    return mesh.topology.edges[(mesh.face_normals[pairs[:, 0]] * mesh.face_normals[pairs[:, 1]]).sum(axis=1) < 0.5]


def table(figures: results.Figures) -> str:
    """Return a table of boundaries and one of creases, each with a caption."""
    boundary_titles = [f'`boundary="{kind}"`' for kind in BOUNDARIES]
    crease_titles = ["no creases", "its edges as creases", f"`creases={ANGLE}` degrees"]
    return "\n\n".join(
        [
            f"A flat square of {STEPS} × {STEPS} cells: mean distance of its boundary from the outline, in cells.",
            _table(boundary_titles, figures["boundaries"]),
            "A cube of six such squares: mean angle between the face normals and the true ones, in degrees.",
            _table(crease_titles, figures["creases"]),
        ]
    )


def _table(titles: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    cells = [[f"`{name}`", f"{level:g}", *(f"{error:.2f}" for error in errors)] for name, level, *errors in rows]
    return results.markdown(["method", "noise", *titles], cells)


if __name__ == "__main__":
    main()
