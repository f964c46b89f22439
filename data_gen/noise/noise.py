"""Random displacements of vertices: kinds of noise, and smooth relief that belongs to the shape."""

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np

from cascadenorm.data_gen.noise.sensor import blurred, laser_displacements, neighbor_means, sensor_displacements
from cascadenorm.data_gen.shapes.patterns import noise, smooth_relief
from cascadenorm.data_gen.shapes.placement import log_uniform, random_rotation
from cascadenorm.mesh import Mesh, Vectors

WIDEST_NOISE = 40  # largest number of neighbour averages of correlated noise, which then extends over eight edges
WHITE_SHARE = 0.15, 0.8  # deviation of the white noise added to correlated noise, as a share of the latter
MOST_ROUNDING = 0.25  # largest deviation of rounding, in mean edge lengths; more would collapse triangles
RELIEF_PASSES = 2.0, 40.0  # averages of white noise over neighbours
RELIEF_HEIGHTS = 0.05, 1.0  # root mean square of averaged white noise, in mean edge lengths

NoiseKind = Literal[
    "normal", "gaussian", "uniform", "impulsive", "varying", "mixed", "correlated", "quantised", "sensor", "laser",
    "none",
]  # fmt: skip
"""Kinds of noise.

- `normal`: Gaussian along vertex normals.
- `gaussian`: Gaussian in each coordinate.
- `uniform`: uniform in each coordinate.
- `impulsive`: Gaussian at a share of the vertices.
- `varying`: Gaussian along vertex normals, with a deviation that varies slowly over the shape.
- `mixed`: a mixture of two of the above.
- `correlated`: spatially correlated over several edges, along normals or in each coordinate. White noise is added,
  since an error without noise at the finest scale could not be told from shape.
- `quantised`: coordinates rounded to a lattice.
- `sensor`: the error of a depth camera, for sheets seen from one side.
- `laser`: the error of a laser scanner.
- `none`: no noise."""


def displacements(mesh: Mesh, kind: NoiseKind, *, level: float, rng: np.random.Generator) -> Vectors:
    """Draw noise of a kind for the vertices of a mesh, (n, 3).

    The level is the standard deviation along the normal or of each coordinate, in mean edge lengths; for impulsive
    noise, at the affected vertices.
    """
    if kind not in _KINDS:
        raise ValueError(f"noise kind is {kind!r}; it must be one of {', '.join(get_args(NoiseKind))}")
    if not level >= 0:
        raise ValueError(f"noise level is {level}; it must be at least 0, in mean edge lengths")
    return _KINDS[kind](mesh, level * mesh.mean_edge_length, rng)


def _normal(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Vectors:
    return np.asarray(rng.normal(scale=deviation, size=(len(mesh.vertices), 1)) * mesh.vertex_normals)


def _gaussian(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Vectors:
    return rng.normal(scale=deviation, size=mesh.vertices.shape)


def _uniform(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Vectors:
    half = np.sqrt(3) * deviation
    return rng.uniform(-half, half, mesh.vertices.shape)


def _impulsive(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Vectors:
    hit = rng.random(len(mesh.vertices)) < rng.uniform(0.05, 0.6)
    if rng.random() < 0.5:
        return _normal(mesh, deviation, rng) * hit[:, None]
    return _gaussian(mesh, deviation, rng) * hit[:, None]


def _varying(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Vectors:
    pattern = noise(wavelength=rng.uniform(0.2, 0.8) * mesh.diagonal, rng=rng)
    factor = np.exp(2 * pattern(mesh.vertices))
    sizes = factor / np.sqrt(np.mean(factor**2)) * rng.normal(scale=deviation, size=len(factor))
    return np.asarray(sizes[:, None] * mesh.vertex_normals)


def _mixed(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Vectors:
    share = rng.uniform(0.2, 0.8)
    kinds = (_normal, _gaussian, _uniform, _impulsive, _varying)
    first, second = (kinds[k] for k in rng.choice(len(kinds), 2, replace=False))
    total = np.sqrt(share) * first(mesh, deviation, rng) + np.sqrt(1 - share) * second(mesh, deviation, rng)
    return np.asarray(total)


def _correlated(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Vectors:
    """Average white noise over neighbours up to WIDEST_NOISE times, rescale it, and add white noise along normals."""
    along = bool(rng.random() < 0.6)
    white = rng.normal(size=(len(mesh.vertices), 1 if along else 3))
    spread = blurred(white, neighbor_means(mesh), round(float(WIDEST_NOISE ** rng.random())))
    spread *= deviation / np.sqrt(np.mean(spread**2))
    error = spread * mesh.vertex_normals if along else spread
    return np.asarray(error + _normal(mesh, rng.uniform(*WHITE_SHARE) * deviation, rng))


def _quantised(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Vectors:
    """Return the error of rounding to a randomly rotated and shifted lattice with a spacing of √12 deviations."""
    spacing = np.sqrt(12) * min(deviation, MOST_ROUNDING * mesh.mean_edge_length)
    if spacing == 0:
        return np.zeros(mesh.vertices.shape)
    turn, shift = random_rotation(rng=rng), rng.random(3)
    nodes = mesh.vertices @ turn / spacing + shift
    return np.asarray(spacing * (np.round(nodes) - nodes) @ turn.T)


_KINDS: dict[NoiseKind, Callable[[Mesh, float, np.random.Generator], Vectors]] = {
    "normal": _normal,
    "gaussian": _gaussian,
    "uniform": _uniform,
    "impulsive": _impulsive,
    "varying": _varying,
    "mixed": _mixed,
    "correlated": _correlated,
    "quantised": _quantised,
    "sensor": sensor_displacements,
    "laser": laser_displacements,
    "none": lambda mesh, deviation, rng: np.zeros(mesh.vertices.shape),
}


def relief(mesh: Mesh, *, rng: np.random.Generator) -> Vectors:
    """Draw a smooth displacement along the normals, 3 to 40 edges wide. Returns (n, 3) displacements in mesh units."""
    kind = rng.choice(["averaged", "pattern", "sines"], p=[0.4, 0.36, 0.24])
    if kind == "averaged":
        white = rng.normal(size=len(mesh.vertices))
        heights = blurred(white, neighbor_means(mesh), round(log_uniform(RELIEF_PASSES, rng=rng)))
        heights *= log_uniform(RELIEF_HEIGHTS, rng=rng) * mesh.mean_edge_length / np.sqrt(np.mean(heights**2))
    else:
        heights = smooth_relief(edge=mesh.mean_edge_length, waves=kind == "sines", rng=rng)(mesh.vertices)
    return np.asarray(heights[:, None] * mesh.vertex_normals)
