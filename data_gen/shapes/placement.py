"""Rigid motions and deformations of fields, and the random numbers that describe them."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from cascadenorm.data_gen.shapes.fields import DistanceField, Values
from cascadenorm.mesh import Floats, Vectors, kernel, unit
from cascadenorm.mesh.vectors import row, subtract


def random_rotation(*, rng: np.random.Generator) -> Vectors:
    """Return a rotation matrix, uniform over all rotations."""
    matrix, triangle = np.linalg.qr(rng.normal(size=(3, 3)))
    matrix = matrix * np.sign(np.diag(triangle))
    return np.asarray(matrix * np.sign(np.linalg.det(matrix)))


def random_direction(*, rng: np.random.Generator) -> Values:
    """Return a unit vector, uniform over the sphere."""
    return np.asarray(unit(rng.normal(size=(1, 3)))[0])


def log_uniform(bounds: tuple[float, float], *, rng: np.random.Generator) -> float:
    """Return a number whose logarithm is uniform between bounds."""
    low, high = bounds
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def moved(field: DistanceField, *, by: ArrayLike = (0.0, 0.0, 0.0), rotation: Vectors | None = None) -> DistanceField:
    """Rotate the shape about the origin, then translate it."""
    shift = np.asarray(by, np.float64)
    if rotation is None:
        return lambda points: field(points - shift)
    turn = np.array(rotation, np.float64, order="C")

    def turned(points: Vectors) -> Values:
        local = np.empty(points.shape)
        _into_frame(points, shift, turn, local)
        return field(local)

    return turned


def aligned(field: DistanceField, axis: ArrayLike, *, by: ArrayLike = (0.0, 0.0, 0.0)) -> DistanceField:
    """Rotate the z axis of the shape to `axis`, then translate the shape."""
    z = unit(np.asarray(axis, np.float64)[None])[0]
    x = unit(np.cross(z, np.eye(3)[np.abs(z).argmin()])[None])[0]
    return moved(field, by=by, rotation=np.stack([x, np.cross(z, x), z], axis=1))


def around(field: DistanceField, *, count: int) -> DistanceField:
    """Repeat what lies about the positive x axis `count` times around z."""
    sector = 2 * np.pi / count

    def repeated(points: Vectors) -> Values:
        angle = np.arctan2(points[:, 1], points[:, 0])
        angle -= sector * np.round(angle / sector)
        radius = np.hypot(points[:, 0], points[:, 1])
        return field(np.stack([radius * np.cos(angle), radius * np.sin(angle), points[:, 2]], axis=1))

    return repeated


def mirrored(field: DistanceField) -> DistanceField:
    """Reflect the half x > 0 to the other side."""
    return lambda points: field(np.stack([np.abs(points[:, 0]), points[:, 1], points[:, 2]], axis=1))


def twisted(field: DistanceField, *, rate: float) -> DistanceField:
    """Rotate cross sections about z by `rate` radians per unit of height."""

    def twist(points: Vectors) -> Values:
        cos, sin = np.cos(rate * points[:, 2]), np.sin(rate * points[:, 2])
        x, y = points[:, 0], points[:, 1]
        stretch = np.sqrt(1 + (rate * np.minimum(np.hypot(x, y), 1.0)) ** 2)
        return field(np.stack([cos * x + sin * y, cos * y - sin * x, points[:, 2]], axis=1)) / stretch

    return twist


def bent(field: DistanceField, *, curvature: float) -> DistanceField:
    """Bend the x axis into an arc of the given curvature in the xy plane."""
    if abs(curvature) < 1e-6:
        return field

    def bend(points: Vectors) -> Values:
        x, y = points[:, 0], 1 / curvature - points[:, 1]
        radius, angle = np.hypot(x, y), np.arctan2(x, y * np.sign(curvature))
        straight = [angle / abs(curvature), 1 / curvature - np.sign(curvature) * radius, points[:, 2]]
        return field(np.stack(straight, axis=1))

    return bend


def tapered(field: DistanceField, *, rate: float) -> DistanceField:
    """Scale cross sections by exp(rate · z)."""

    def taper(points: Vectors) -> Values:
        growth = np.exp(rate * points[:, 2])
        return field(points / np.stack([growth, growth, np.ones(len(points))], axis=1)) * np.minimum(growth, 1)

    return taper


def warped(field: DistanceField, warps: Sequence[DistanceField], *, amplitude: float) -> DistanceField:
    """Displace the positions at which the field is evaluated by three scalar patterns."""
    return lambda points: field(points + amplitude * np.stack([warp(points) for warp in warps], axis=1))


@kernel
def _into_frame(points: Vectors, shift: Floats, turn: Floats, local: Vectors) -> None:
    for n in range(len(points)):
        x, y, z = subtract(row(points, n), shift)
        for k in range(3):
            local[n, k] = x * turn[0, k] + y * turn[1, k] + z * turn[2, k]
