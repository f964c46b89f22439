"""What rims and creases gain: python benchmarks/controls.py writes benchmarks/controls.md."""

from pathlib import Path

import numpy as np

import cascadenorm as cn
from cascadenorm.mesh import Mesh
from cascadenorm.metrics import measure

METHODS = ("auto", "bilateral-normal", "laplacian")
STEPS = 30  # edges along a side
LEVELS = (0.1, 0.2)  # of the noise, in edge lengths, in all directions


def sheet() -> Mesh:
    """Return a flat square of STEPS × STEPS cells."""
    y, x = np.divmod(np.arange((STEPS + 1) ** 2), STEPS + 1)
    a = np.flatnonzero((x < STEPS) & (y < STEPS))
    b, c, d = a + 1, a + STEPS + 2, a + STEPS + 1
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh(np.stack([x, y, 0 * x], axis=1).astype(float), faces)


def cube() -> Mesh:
    """Return a closed cube of six such squares."""
    flat, turns = sheet(), [np.roll(np.eye(3), k, axis=1) for k in range(3)]
    low = [flat.vertices[:, [1, 0, 2]] @ turn for turn in turns]  # wound the other way round
    high = [(flat.vertices + np.array([0, 0, STEPS])) @ turn for turn in turns]
    corners = np.concatenate([side[flat.faces] for side in (*low, *high)]).reshape(-1, 3)
    vertices, numbers = np.unique(corners.round(), axis=0, return_inverse=True)
    return Mesh(vertices, numbers.reshape(-1, 3))


def noisy(mesh: Mesh, level: float) -> Mesh:
    """Return the mesh with noise."""
    noise = np.random.default_rng(0).normal(size=mesh.vertices.shape)
    return mesh.moved(mesh.vertices + level * mesh.mean_edge_length * noise)


def rim_error(mesh: Mesh) -> float:
    """Mean distance of the rim of a denoised sheet from its outline along the sheet, in edge lengths."""
    x, y = mesh.vertices[mesh.topology.boundary_vertices, :2].T
    return float(np.mean(np.min(np.abs([x, y, x - STEPS, y - STEPS]), axis=0)))


def sharp_edges(mesh: Mesh) -> np.ndarray:
    """(k, 2) vertices of the edges of a cube."""
    pairs = mesh.topology.edge_faces.indices.reshape(-1, 2)
    return mesh.topology.edges[(mesh.normals[pairs[:, 0]] * mesh.normals[pairs[:, 1]]).sum(axis=1) < 0.5]


def main() -> None:
    """Measure, and write the tables."""
    flat, box = sheet(), cube()
    edges = sharp_edges(box)
    rims, creases = [], []
    for level in LEVELS:
        rough, rough_box = noisy(flat, level), noisy(box, level)
        for name in METHODS:
            by_rim = [cn.denoise(rough, method=name, boundary=kind) for kind in ("free", "smooth")]
            cells = [f"{rim_error(mesh):.2f}" for mesh in by_rim]
            rims.append(f"| `{name}` | {level} | {' | '.join(cells)} |")
            by_crease = [cn.denoise(rough_box, method=name, creases=given) for given in (None, edges, 40)]
            cells = [f"{measure(mesh, box).normal_error_deg:.2f}" for mesh in by_crease]
            creases.append(f"| `{name}` | {level} | {' | '.join(cells)} |")
    text = [
        "Made by `python benchmarks/controls.py`; noise in mean edge lengths, in all directions.",
        "",
        f"A flat square of {STEPS} × {STEPS} cells: mean distance of its rim from the outline, in edge lengths.",
        "",
        '| method | noise | `boundary="free"` | `boundary="smooth"` |',
        "| --- | ---: | ---: | ---: |",
        *rims,
        "",
        "A cube of six such squares: mean angle between the normals of faces and the true ones, in degrees.",
        "",
        "| method | noise | no creases | its edges as creases | `creases=40` degrees |",
        "| --- | ---: | ---: | ---: | ---: |",
        *creases,
    ]
    Path(__file__).with_suffix(".md").write_text("\n".join(text) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
