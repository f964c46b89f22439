"""Meshes with one defect each, for docs/dirty-input.md, benchmarks/dirty_input.md and their tests."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

AROUND, ACROSS, NOISE = 24, 12, 0.03
UTM = (500_000.0, 5_000_000.0, 100.0)


class Dirty(NamedTuple):
    """A mesh and how it was made from the sound one.

    Parameters
    ----------
    vertices
        (n, 3) float64 or float32; if `alike`, the first AROUND · ACROSS are those of the sound mesh times `scale` plus
        `offset`.
    faces
        (m, 3).
    alike
        Whether the same result is expected at these vertices, up to scale and offset.
    """

    vertices: NDArray[Any]
    faces: NDArray[np.int64]
    alike: bool = False
    scale: float = 1.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


def sound() -> Dirty:
    """Return a noisy torus."""
    u, v = np.divmod(np.arange(AROUND * ACROSS), ACROSS)
    phi, psi = 2 * np.pi * u / AROUND, 2 * np.pi * v / ACROSS
    right, up, both = ((u + i) % AROUND * ACROSS + (v + j) % ACROSS for i, j in ((1, 0), (0, 1), (1, 1)))
    arm = 2 + np.cos(psi)
    vertices = np.stack([arm * np.cos(phi), arm * np.sin(phi), np.sin(psi)], axis=1)
    here = np.arange(len(vertices))
    faces = np.concatenate([np.stack(t, axis=1) for t in ((here, right, both), (here, both, up))])
    return Dirty(vertices + np.random.default_rng(0).normal(scale=NOISE, size=vertices.shape), faces, alike=True)


def tetrahedra(count: int) -> Dirty:
    """Return tetrahedra, some of which intersect."""
    shifts = np.random.default_rng(1).uniform(-50, 50, (count, 1, 3))
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float) + shifts
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]) + 4 * np.arange(count)[:, None, None]
    return Dirty(vertices.reshape(-1, 3), faces.reshape(-1, 3))


def dirty_meshes() -> dict[str, Dirty]:
    """Return each mesh by its name, the sound one first."""
    vertices, faces = sound()[:2]
    count = len(vertices)
    middle = vertices[faces[0]].mean(axis=0)
    side = 0.5 * (vertices[faces[0, 0]] + vertices[faces[0, 1]])
    strip = np.arange(3)

    def more(points: Any, rows: Any) -> Dirty:
        points = np.asarray(points, float).reshape(-1, 3)
        return Dirty(np.concatenate([vertices, points]), np.concatenate([faces, np.asarray(rows).reshape(-1, 3)]))

    def changed(place: int, value: Any) -> Dirty:
        moved = vertices.copy()
        moved[place] = value
        return Dirty(moved, faces)

    def scaled(scale: float, offset: Any = (0.0, 0.0, 0.0), kind: type = np.float64) -> Dirty:
        return Dirty((vertices * scale + offset).astype(kind), faces, True, scale, offset)

    flipped, inside_out = faces.copy(), faces[:, ::-1].copy()
    flipped[::3] = flipped[::3, ::-1]
    return {
        "sound": sound(),
        "a vertex is not a number": changed(7, np.nan),
        "a vertex is infinite": changed(7, (np.inf, 0, 0)),
        "a face references a vertex past the last": more([], [0, 1, count]),
        "a face references vertex 1,000,000,000": more([], [0, 1, 10**9]),
        "a face references vertex -1": more([], [0, 1, -1]),
        "a face repeats a vertex": more([], [[0, 0, 1], [5, 5, 5]]),
        "faces without area": more([vertices[0], side], [[0, 1, count], [0, faces[0, 1], count + 1]]),
        "slivers": more([middle, middle + 1e-9], [[faces[0, 0], faces[0, 1], count], [faces[0, 0], count, count + 1]]),
        "every face twice": Dirty(vertices, np.concatenate([faces, faces])),
        "a face and its reverse": more([], faces[3, ::-1]),
        "vertices without a face": more([[9, 9, 9], [1e30, 0, 0]], np.zeros((0, 3), int))._replace(alike=True),
        "edges with three faces": more(
            vertices[faces[:9, 0]] * 1.3, np.column_stack([faces[:9, :2], count + np.arange(9)])
        ),
        "components joined at a vertex": more(vertices[0] + [[0.5, 0.3, 0], [0.5, -0.3, 0.2]], [0, count, count + 1]),
        "every third face flipped": Dirty(vertices, flipped, alike=True),
        "inside out": Dirty(vertices, inside_out, alike=True),
        "passes through itself": Dirty(
            np.concatenate([vertices, vertices[:, [2, 0, 1]] + 1]), np.concatenate([faces, faces + count])
        ),
        "soup: no vertex is shared": Dirty(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)),
        "2,000 components": tetrahedra(2000),
        "a single triangle": Dirty(vertices[strip], strip[None]),
        "open": Dirty(vertices, faces[: len(faces) // 3]),
        "no vertices, no faces": Dirty(np.zeros((0, 3)), np.zeros((0, 3), int)),
        "points without faces": Dirty(vertices, np.zeros((0, 3), int)),
        "coordinates about 1e-8": scaled(1e-8),
        "coordinates about 1e8": scaled(1e8),
        "millimetres at UTM coordinates, float64": scaled(1e-3, UTM),
        "metres at UTM coordinates, float32": scaled(1.0, UTM, np.float32),
        "coordinates about 1e300": scaled(1e300),
        "denormal coordinates, about 1e-310": scaled(1e-310),
        "a spike of 1e6": changed(7, (1e6, 0, 0)),
    }
