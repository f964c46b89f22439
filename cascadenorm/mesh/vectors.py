"""Operations on 3-vectors in kernels; the compiler inlines them."""

import numpy as np

from cascadenorm.compute.arrays import Floats, Index
from cascadenorm.compute.kernels import kernel

Vector = tuple[float, float, float]
Three = Vector | Floats  # a vector, as a tuple or as a row of an array


@kernel
def row(points: Floats, i: Index) -> Vector:
    """Return row i of an (n, 3) array."""
    return points[i, 0], points[i, 1], points[i, 2]


@kernel
def add(u: Three, v: Three) -> Vector:
    return u[0] + v[0], u[1] + v[1], u[2] + v[2]


@kernel
def subtract(u: Three, v: Three) -> Vector:
    return u[0] - v[0], u[1] - v[1], u[2] - v[2]


@kernel
def scaled(factor: float, u: Three) -> Vector:
    return factor * u[0], factor * u[1], factor * u[2]


@kernel
def divided(u: Three, divisor: float) -> Vector:
    """Return u / divisor; multiplying by 1 / divisor would round twice."""
    return u[0] / divisor, u[1] / divisor, u[2] / divisor


@kernel
def dot(u: Three, v: Three) -> float:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@kernel
def cross(u: Three, v: Three) -> Vector:
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@kernel
def area_vector(a: Three, b: Three, c: Three) -> Vector:
    """Return the normal of a triangle times its area."""
    return scaled(0.5, cross(subtract(b, a), subtract(c, a)))


@kernel
def length(u: Three) -> float:
    size: float = np.sqrt(dot(u, u))
    return size


@kernel
def squared_distance(p: Three, q: Three) -> float:
    """Return the squared distance of two points, or the squared chord of two unit vectors."""
    u = subtract(p, q)
    return dot(u, u)
