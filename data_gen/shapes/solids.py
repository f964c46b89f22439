"""Polyhedra, and plain solids with engraved or embossed detail."""

import numpy as np

from cascadenorm.data_gen.shapes.fields import (
    DistanceField,
    Values,
    box,
    cylinder,
    difference,
    half_space,
    intersection,
    limb,
    offset,
    polytope,
    shell,
    sphere,
    torus,
    union,
)
from cascadenorm.data_gen.shapes.placement import aligned, moved, random_direction, random_rotation
from cascadenorm.mesh import Vectors, unit

GOLDEN = (1 + 5**0.5) / 2
IRREGULAR = 0.06  # deviation of the faces of a polyhedron from those of a regular one, in radians per direction


def polyhedron(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a convex solid, nearly regular or random, or a star-shaped one, with sharp or slightly rounded edges."""
    kind = rng.integers(5)
    if kind == 0:
        normals = _regular(rng)
        size = rng.uniform(0.72, 0.85, len(normals))
    elif kind == 1:
        normals = unit(rng.normal(size=(rng.integers(6, 40), 3)))
        size = rng.uniform(0.65, 0.85, len(normals))
    elif kind == 2:
        normals = np.concatenate([_regular(rng), _regular(rng)])
        size = rng.uniform(0.7, 0.85, len(normals))
    else:
        return _star(rng)
    size = np.append(size, np.full(6, 1.1))
    solid = polytope(np.concatenate([normals, np.eye(3), -np.eye(3)]), size)
    if rng.random() < 0.3:
        solid = intersection(solid, sphere(radius=rng.uniform(0.85, 1.0)))
    if rng.random() < 0.25:
        solid = shell(solid, thickness=0.3)
        solid = difference(solid, *[aligned(cylinder(radius=0.3, half_height=3), axis) for axis in normals[:3]])
    return solid


def _regular(rng: np.random.Generator) -> Vectors:
    """Return normals within about IRREGULAR of a Platonic solid, since regular ones are common test models."""
    signs = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1
    cyclic = [np.roll(np.eye(3), k, axis=1) for k in range(3)]
    edges = np.array([[0, s, t * GOLDEN] for s in (-1, 1) for t in (-1, 1)])
    dodeca = np.concatenate([np.roll(edges, k, axis=1) for k in range(3)])
    thin = np.array([[0, s / GOLDEN, t * GOLDEN] for s in (-1, 1) for t in (-1, 1)])
    icosa = np.concatenate([signs, *[np.roll(thin, k, axis=1) for k in range(3)]])
    rhombic = np.array([[0, s, t] for s in (-1, 1) for t in (-1, 1)])
    rhombic = np.concatenate([np.roll(rhombic, k, axis=1) for k in range(3)])
    sets = [np.concatenate([cyclic[0], -cyclic[0]]), signs, dodeca, icosa, rhombic, signs[[0, 3, 5, 6]]]
    normals = unit(np.asarray(sets[rng.integers(len(sets))], np.float64))
    return unit(normals + IRREGULAR * rng.normal(size=normals.shape))


def _star(rng: np.random.Generator) -> DistanceField:
    """Return a stellation, the points beyond at most one plane of a convex solid, or crossed solids."""
    normals = _regular(rng)
    if len(normals) < 8 or rng.random() < 0.4:
        sizes = 0.6 * rng.uniform(0.93, 1.07, (2, len(normals)))
        solids = [polytope(normals @ random_rotation(rng=rng), size) for size in sizes]
        return intersection(union(*solids), sphere(radius=rng.uniform(0.8, 1.2)))
    core = rng.uniform(0.45, 0.55) * rng.uniform(0.93, 1.07, len(normals))

    def second(points: Vectors) -> Values:
        return np.asarray(np.partition(points @ normals.T - core, -2, axis=1)[:, -2])

    return intersection(second, sphere(radius=rng.uniform(0.9, 1.3)))


def engraved(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a plain solid with engraved or embossed lines, steps and dimples, down to a few edge lengths wide."""
    body = skin = _plain_body(edge, rng)
    for _ in range(rng.integers(2, 7)):
        width = edge * rng.uniform(1.5, 3.5)
        kind = rng.integers(4)
        if kind == 0:
            plane = half_space(random_direction(rng=rng), at=rng.uniform(-0.6, 0.6))
            tool = shell(plane, thickness=2 * width)
        elif kind == 1:
            a, b = random_direction(rng=rng), random_direction(rng=rng)
            tool = limb(0.9 * a, 0.9 * b, radii=(width + 0.1, width + 0.1))
        elif kind == 2:
            tool = moved(sphere(radius=rng.uniform(0.08, 0.3)), by=0.8 * random_direction(rng=rng))
        else:
            tool = moved(box([width, width, 2.0]), by=rng.uniform(-0.5, 0.5, 3), rotation=random_rotation(rng=rng))
        depth = edge * rng.uniform(1.5, 3.5)
        if rng.random() < 0.6:
            part = intersection(tool, offset(skin, by=0.3)) if kind == 2 else difference(tool, offset(skin, by=-depth))
            body = difference(body, part)
        else:
            body = union(body, intersection(tool, offset(skin, by=depth)))
    return body


def _plain_body(edge: float, rng: np.random.Generator) -> DistanceField:
    kind = rng.integers(4)
    if kind == 0:
        return sphere(radius=rng.uniform(0.7, 0.95))
    if kind == 1:
        return cylinder(radius=rng.uniform(0.5, 0.85), half_height=rng.uniform(0.4, 0.9))
    if kind == 2:
        return offset(box(rng.uniform(0.4, 0.75, 3)), by=float(rng.choice([0.0, rng.uniform(2 * edge, 0.25)])))
    return torus(major=0.75, minor=rng.uniform(0.25, 0.4))
