"""What smooth boundaries and creases gain: python -m benchmarks.accuracy.controls writes benchmarks/controls.md."""

import sys
from pathlib import Path

import numpy as np

import cascadenorm as cn
from cascadenorm.geometry.metrics import measure
from cascadenorm.mesh import Mesh

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from shapes import cube, grid, noisy

METHODS = ("auto", "bilateral-normal", "laplacian")
STEPS = 30  # edges along a side
LEVELS = (0.1, 0.2)  # of the noise, in mean edge lengths, in all directions


def boundary_error(mesh: Mesh) -> float:
    """Mean distance of the boundary of a denoised grid of unit squares from its outline, along the grid."""
    x, y = mesh.vertices[mesh.topology.boundary_vertices, :2].T
    return float(np.mean(np.min(np.abs([x, y, x - STEPS, y - STEPS]), axis=0)))


def sharp_edges(mesh: Mesh) -> np.ndarray:
    """(k, 2) vertices of the edges of a cube."""
    pairs = mesh.topology.edge_faces.indices.reshape(-1, 2)
    return mesh.topology.edges[(mesh.face_normals[pairs[:, 0]] * mesh.face_normals[pairs[:, 1]]).sum(axis=1) < 0.5]


def main() -> None:
    """Measure, and write the tables."""
    flat, box = grid(STEPS, STEPS), cube(STEPS)
    edges = sharp_edges(box)
    boundaries, creases = [], []
    for level in LEVELS:
        rough, rough_box = noisy(flat, level), noisy(box, level)
        for name in METHODS:
            by_boundary = [cn.denoise(rough, method=name, boundary=kind) for kind in ("free", "smooth")]
            cells = [f"{boundary_error(mesh):.2f}" for mesh in by_boundary]
            boundaries.append(f"| `{name}` | {level} | {' | '.join(cells)} |")
            by_crease = [cn.denoise(rough_box, method=name, creases=given) for given in (None, edges, 40)]
            cells = [f"{measure(mesh, box).normal_error_deg:.2f}" for mesh in by_crease]
            creases.append(f"| `{name}` | {level} | {' | '.join(cells)} |")
    text = [
        "# Boundaries and creases",
        "",
        "Noise is in mean edge lengths, in all directions. `python -m benchmarks.accuracy.controls` writes this page.",
        "",
        f"A flat square of {STEPS} × {STEPS} cells: mean distance of its boundary from the outline, in cells.",
        "",
        '| method | noise | `boundary="free"` | `boundary="smooth"` |',
        "| --- | ---: | ---: | ---: |",
        *boundaries,
        "",
        "A cube of six such squares: mean angle between the normals of faces and the true ones, in degrees.",
        "",
        "| method | noise | no creases | its edges as creases | `creases=40` degrees |",
        "| --- | ---: | ---: | ---: | ---: |",
        *creases,
    ]
    (Path(__file__).parents[1] / "controls.md").write_text("\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
