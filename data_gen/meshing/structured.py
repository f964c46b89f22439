"""Meshes over a grid of parameters, and subdivided cages.

Such meshes come from modelling programs and elevation data: surfaces of revolution, tori, terrains. Their triangles are
as regular as those of scanned grids.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.decimate import thinned
from cascadenorm.data_gen.meshing.surface import fit
from cascadenorm.data_gen.shapes.patterns import noise
from cascadenorm.data_gen.shapes.placement import log_uniform
from cascadenorm.mesh import Mesh

FEWEST_CAGE_FACES = 60
# Ratios of rows to columns. Triangles are elongated up to about fifteen times, along the rows or the columns
TORUS_RATIOS = 0.2, 40.0
REVOLVED_RATIOS = 0.1, 20.0


def grid_faces(rows: int, columns: int, *, around: tuple[bool, bool], rng: np.random.Generator) -> NDArray[np.int32]:
    """Split each quadrilateral of a grid of vertices into two triangles.

    The diagonals all run one way, alternate, or are random. `around` tells whether the rows, and the columns, are
    cyclic.
    """
    index = np.arange(rows * columns).reshape(rows, columns)
    if around[0]:
        index = np.concatenate([index, index[:1]])
    if around[1]:
        index = np.concatenate([index, index[:, :1]], axis=1)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    row, column = np.divmod(np.arange(len(a)), index.shape[1] - 1)
    diagonals = rng.choice(["one", "alternating", "random"], p=[0.6, 0.25, 0.15])
    other = {
        "one": np.full(len(a), bool(rng.random() < 0.5)),
        "alternating": (row + column) % 2 == 0,
        "random": rng.random(len(a)) < 0.5,
    }[str(diagonals)]
    first = np.where(other[:, None], np.stack([a, b, d], axis=1), np.stack([a, b, c], axis=1))
    second = np.where(other[:, None], np.stack([b, c, d], axis=1), np.stack([a, c, d], axis=1))
    return np.concatenate([first, second]).astype(np.int32)


def _numbers(faces: int, ratio: float) -> tuple[int, int]:
    """Split a number of faces into rows and columns of vertices with the given ratio of rows to columns."""
    quadrilaterals = faces / 2
    rows = max(round(np.sqrt(quadrilaterals * ratio)), 6)
    return rows, max(round(quadrilaterals / rows), 6)


def _torus(*, faces: int, rng: np.random.Generator) -> Mesh:
    """Sweep a closed, lobed profile around a ring that may wave up and down."""
    rows, columns = _numbers(faces, log_uniform(TORUS_RATIOS, rng=rng))
    u = np.linspace(0, 2 * np.pi, rows, endpoint=False)[:, None]
    v = np.linspace(0, 2 * np.pi, columns, endpoint=False)[None, :]
    minor = rng.uniform(0.12, 0.42) * (1 + rng.uniform(0, 0.25) * np.cos(int(rng.integers(2, 7)) * v))
    minor = minor * (1 + rng.uniform(0, 0.2) * np.cos(int(rng.integers(1, 6)) * u))
    distance = 0.75 + minor * np.cos(v)
    height = minor * np.sin(v) + rng.uniform(0, 0.25) * np.sin(int(rng.integers(1, 4)) * u)
    points = np.stack([distance * np.cos(u), distance * np.sin(u), height], axis=-1)
    return fit(Mesh(points.reshape(-1, 3), grid_faces(rows, columns, around=(True, True), rng=rng)))


def _revolved(*, faces: int, rng: np.random.Generator) -> Mesh:
    """Revolve a profile, smooth or with kinks, around an axis. The ends stay open."""
    rows, columns = _numbers(faces, log_uniform(REVOLVED_RATIOS, rng=rng))
    height = np.linspace(-0.9, 0.9, columns)
    knots = int(rng.integers(3, 9))
    radii = rng.uniform(0.15, 0.7, knots)
    at = np.linspace(-0.9, 0.9, knots)
    if rng.random() < 0.5:
        radius = np.interp(height, at, radii)
    else:
        waves = np.cos(np.pi * np.arange(knots)[:, None] * (height[None, :] + 0.9) / 1.8)
        radius = 0.45 + 0.3 * np.clip((radii - 0.4) @ waves / np.sqrt(knots), -1, 1)
    angle = np.linspace(0, 2 * np.pi, rows, endpoint=False)[:, None]
    lobes = 1 + rng.choice([0.0, rng.uniform(0, 0.2)]) * np.cos(int(rng.integers(2, 9)) * angle)
    distance = radius[None, :] * lobes
    z = np.broadcast_to(height[None, :], distance.shape)
    points = np.stack([distance * np.cos(angle), distance * np.sin(angle), z], axis=-1)
    return fit(Mesh(points.reshape(-1, 3), grid_faces(rows, columns, around=(True, False), rng=rng)))


def terrain_mesh(*, faces: int, rng: np.random.Generator) -> Mesh:
    """Make a terrain with about `faces` faces; raise UnfitShapeError if it is invalid.

    The heights are noise with wavelengths down to a few posts, some rounded to steps.
    """
    rows, columns = _numbers(faces, log_uniform((0.5, 2.0), rng=rng))
    x, y = np.meshgrid(np.arange(rows, dtype=float), np.arange(columns, dtype=float), indexing="ij")
    y = y * log_uniform((0.5, 2.0), rng=rng)
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    heights = np.zeros(len(points))
    for _ in range(rng.integers(1, 5)):
        wavelength = log_uniform((4.0, 60.0), rng=rng)
        form = rng.choice(["smooth", "ridged", "billowed"])
        height = wavelength * log_uniform((0.01, 0.2), rng=rng)
        heights += height * noise(wavelength=wavelength, form=form, rng=rng)(points)
    if rng.random() < 0.3:
        step = log_uniform((0.002, 0.05), rng=rng)
        heights = np.round(heights / step) * step
    points[:, 2] = heights
    return fit(Mesh(points * (2 / rows), grid_faces(rows, columns, around=(False, False), rng=rng)[:, ::-1]))


STRUCTURED: tuple[Callable[..., Mesh], ...] = (_torus, _revolved, terrain_mesh)


def structured_mesh(*, faces: int, rng: np.random.Generator) -> Mesh:
    """Make a surface over a grid of parameters with about `faces` faces; raise UnfitShapeError if it is invalid."""
    return STRUCTURED[rng.integers(len(STRUCTURED))](faces=faces, rng=rng)


def subdivided_cage(mesh: Mesh, *, faces: int, rng: np.random.Generator) -> Mesh:
    """Decimate a closed mesh to a cage and subdivide it smoothly (Loop 1987) or within the planes of its faces.

    The cage has fewer faces than wanted by a power of four. Raises UnfitShapeError if it is invalid or has too few.
    """
    levels = int(rng.integers(1, 4))
    cage_faces = faces // 4**levels
    if cage_faces < FEWEST_CAGE_FACES:
        raise UnfitShapeError("the cage has too few faces")
    cage = thinned(mesh, faces=cage_faces, evenness=float(10 ** rng.uniform(-4, -1)))
    smooth = bool(rng.random() < 0.75)
    subdivide: Any = trimesh.remesh.subdivide_loop if smooth else trimesh.remesh.subdivide
    vertices, triangles = cage.vertices, cage.faces
    for _ in range(levels):
        vertices, triangles = subdivide(vertices, triangles)
    return fit(Mesh(np.asarray(vertices, np.float64), np.asarray(triangles, np.int32)))
