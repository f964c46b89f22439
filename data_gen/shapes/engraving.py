"""Plain solids with engraved or embossed detail."""

import numpy as np

from cascadenorm.data_gen.shapes.fields import (
    DistanceField,
    box,
    cylinder,
    difference,
    intersection,
    limb,
    offset,
    sphere,
    torus,
    union,
)
from cascadenorm.data_gen.shapes.placement import moved, random_direction, random_rotation
from cascadenorm.mesh import Vectors


def engraved(edge: float, rng: np.random.Generator) -> DistanceField:
    """Return a plain solid with engraved or embossed lines, steps and dimples, down to a few edge lengths wide."""
    body, skin = _plain_body(edge, rng)
    for _ in range(rng.integers(2, 7)):
        width = edge * rng.uniform(1.5, 3.5)
        kind = rng.integers(4)
        if kind == 0:
            plane, level = random_direction(rng=rng), rng.uniform(-0.6, 0.6)
            tool: DistanceField = _slab(plane, level, width)
        elif kind == 1:
            a, b = random_direction(rng=rng), random_direction(rng=rng)
            tool = limb(0.9 * a, 0.9 * b, radii=(width + 0.1, width + 0.1))
        elif kind == 2:
            tool = moved(sphere(radius=rng.uniform(0.08, 0.3)), by=0.8 * random_direction(rng=rng))
        else:
            tool = moved(box([width, width, 2.0]), by=rng.uniform(-0.5, 0.5, 3), rotation=random_rotation(rng=rng))
        depth = edge * rng.uniform(1.5, 3.5)
        if rng.random() < 0.6:
            body = difference(
                body, intersection(tool, offset(skin, by=0.3)) if kind == 2 else _within(tool, skin, depth)
            )
        else:
            body = union(body, intersection(tool, offset(skin, by=depth)))
    return body


def _within(tool: DistanceField, skin: DistanceField, depth: float) -> DistanceField:
    """Return the part of a tool that lies less than a depth below the surface."""
    return lambda points: np.maximum(tool(points), -skin(points) - depth)


def _slab(plane: Vectors, level: float, width: float) -> DistanceField:
    return lambda points: np.abs(points @ plane - level) - width


def _plain_body(edge: float, rng: np.random.Generator) -> tuple[DistanceField, DistanceField]:
    kind = rng.integers(4)
    if kind == 0:
        body = sphere(radius=rng.uniform(0.7, 0.95))
    elif kind == 1:
        body = cylinder(radius=rng.uniform(0.5, 0.85), half_height=rng.uniform(0.4, 0.9))
    elif kind == 2:
        body = offset(box(rng.uniform(0.4, 0.75, 3)), by=float(rng.choice([0.0, rng.uniform(2 * edge, 0.25)])))
    else:
        body = torus(major=0.75, minor=rng.uniform(0.25, 0.4))
    return body, body
