"""Signed-distance fields: primitives and operators that combine and deform them.

The values are negative inside.
"""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.mesh import Floats, Vectors, kernel
from cascadenorm.mesh.vectors import dot, length, row, subtract

Values = NDArray[np.float64]  # (n,) float64, one value per point

DistanceField = Callable[[Vectors], Values]  # positions to signed distances, which are approximate in deformed fields

Blend = Literal["sharp", "round", "chamfer", "melted"]
"""How the edge between two surfaces is finished: sharp, rounded, chamfered, or melted as between metaballs."""


def norm(vectors: NDArray[np.float64]) -> Values:
    """Return the length of each row."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def computed(kernel: Callable[..., None], *parameters: Any) -> DistanceField:
    """Return the field whose values a kernel writes, from points and parameters."""

    def distance(points: Vectors) -> Values:
        values = np.empty(len(points))
        kernel(points, *parameters, values)
        return values

    return distance


def sphere(*, radius: float) -> DistanceField:
    """Return a ball around the origin."""
    return lambda points: norm(points) - radius


def box(half: ArrayLike) -> DistanceField:
    """Return a box, or a rectangle for points in a plane, around the origin with half edge lengths `half`."""
    return computed(_box, np.asarray(half, np.float64))


def ellipsoid(radii: ArrayLike) -> DistanceField:
    """Return an ellipsoid around the origin. The distance is correct to first order near its surface."""
    radii = np.asarray(radii, np.float64)

    def distance(points: Vectors) -> Values:
        scaled = norm(points / radii)
        gradient = norm(points / radii**2)
        return np.where(gradient > 0, scaled * (scaled - 1) / np.maximum(gradient, 1e-12), -radii.min())

    return distance


def superquadric(radii: ArrayLike, *, exponent: float) -> DistanceField:
    """Return the points with sum |x / r| ** exponent = 1: 2 gives an ellipsoid, 1 an octahedron."""
    radii = np.asarray(radii, np.float64)

    def distance(points: Vectors) -> Values:
        scaled = np.abs(points / radii) + 1e-9
        top = scaled.max(axis=1, keepdims=True)
        level = top[:, 0] * ((scaled / top) ** exponent).sum(axis=1) ** (1 / exponent)
        gradient = norm((scaled / level[:, None]) ** (exponent - 1) / radii)
        return np.asarray((level - 1) / np.maximum(gradient, 1e-6))

    return distance


def cylinder(*, radius: float, half_height: float) -> DistanceField:
    """Return a capped cylinder around the z axis."""

    def distance(points: Vectors) -> Values:
        excess = np.stack([norm(points[:, :2]) - radius, np.abs(points[:, 2]) - half_height], axis=1)
        return np.asarray(norm(np.maximum(excess, 0)) + np.minimum(excess.max(axis=1), 0))

    return distance


def torus(*, major: float, minor: float) -> DistanceField:
    """Return a tube of radius `minor` around a circle of radius `major` in the xy plane."""
    return lambda points: np.hypot(norm(points[:, :2]) - major, points[:, 2]) - minor


def limb(start: ArrayLike, end: ArrayLike, *, radii: tuple[float, float]) -> DistanceField:
    """Return a segment thickened by a radius that varies linearly from one end to the other."""
    return tube(np.stack([np.asarray(start, np.float64), np.asarray(end, np.float64)]), radius=np.array(radii))


def tube(path: Vectors, *, radius: float | Values, closed: bool = False) -> DistanceField:
    """Return a polyline thickened by one radius, or by one radius per point of the path."""
    ends = np.roll(path, -1, axis=0) if closed else path[1:]
    starts = path if closed else path[:-1]
    thickness = np.broadcast_to(np.asarray(radius, np.float64), len(path)).copy()
    axes = ends - starts
    length2 = np.maximum(np.einsum("ij,ij->i", axes, axes), 1e-12)
    growth = (np.roll(thickness, -1) if closed else thickness[1:]) - thickness[: len(starts)]
    return computed(_tube, starts, axes, length2, thickness[: len(starts)], growth)


def half_space(normal: Vectors, *, at: float) -> DistanceField:
    """Return the half space behind the plane with a unit normal, (3,), at an offset from the origin."""
    return lambda points: points @ normal - at


def polytope(normals: Vectors, offsets: Values) -> DistanceField:
    """Return the intersection of half spaces with unit `normals`, each at its offset from the origin."""
    return computed(_polytope, normals, offsets)


def complement(field: DistanceField) -> DistanceField:
    """Swap inside and outside."""
    return lambda points: -field(points)


def union(*fields: DistanceField, blend: Blend = "sharp", radius: float = 0.0) -> DistanceField:
    """Return the points of any of the fields. `blend` decides how the concave edge is finished."""

    def distance(points: Vectors) -> Values:
        total = fields[0](points)
        for field in fields[1:]:
            total = _join(total, field(points), blend, radius)
        return total

    return distance


def intersection(*fields: DistanceField, blend: Blend = "sharp", radius: float = 0.0) -> DistanceField:
    """Return the points of all fields. `blend` decides how the convex edge is finished."""
    return complement(union(*map(complement, fields), blend=blend, radius=radius))


def difference(
    field: DistanceField, *removed: DistanceField, blend: Blend = "sharp", radius: float = 0.0
) -> DistanceField:
    """Return the points of the first field that are in none of the others."""
    return intersection(field, *map(complement, removed), blend=blend, radius=radius)


def _join(a: Values, b: Values, blend: Blend, radius: float) -> Values:
    if blend == "sharp" or radius <= 0:
        return np.minimum(a, b)
    if blend == "chamfer":
        return np.asarray(np.minimum(np.minimum(a, b), (a + b - radius) * np.sqrt(0.5)))
    if blend == "melted":
        h = np.maximum(radius - np.abs(a - b), 0) / radius
        return np.asarray(np.minimum(a, b) - h**3 * radius / 6)
    bite = np.hypot(np.maximum(radius - a, 0), np.maximum(radius - b, 0))
    return np.maximum(radius, np.minimum(a, b)) - bite


def melted(*fields: DistanceField, radius: float) -> DistanceField:
    """Return the union with a curvature-continuous transition about `radius` wide, as between metaballs."""
    return union(*fields, blend="melted", radius=radius)


def offset(field: DistanceField, *, by: float) -> DistanceField:
    """Grow the shape by a distance, which rounds convex edges."""
    return lambda points: field(points) - by


def shell(field: DistanceField, *, thickness: float) -> DistanceField:
    """Keep only a shell, half of `thickness` to either side of the surface."""
    return lambda points: np.abs(field(points)) - 0.5 * thickness


def pushed_out(field: DistanceField, pattern: DistanceField, *, amplitude: float) -> DistanceField:
    """Displace the surface outward by a pattern times the amplitude."""
    return lambda points: field(points) - amplitude * pattern(points)


@kernel
def _box(points: Vectors, half: Floats, values: Floats) -> None:
    for n in range(len(points)):
        inner, outer = -np.inf, 0.0
        for k in range(len(half)):
            excess = abs(points[n, k]) - half[k]
            inner = max(inner, excess)
            outer += max(excess, 0.0) ** 2
        values[n] = np.sqrt(outer) + min(inner, 0.0)


@kernel
def _polytope(points: Vectors, normals: Vectors, offsets: Floats, values: Floats) -> None:
    for n in range(len(points)):
        most = -np.inf
        for k in range(len(offsets)):
            most = max(most, dot(row(points, n), row(normals, k)) - offsets[k])
        values[n] = most


@kernel
def _tube(
    points: Vectors, starts: Vectors, axes: Vectors, length2: Floats, thickness: Floats, growth: Floats, values: Floats
) -> None:
    for n in range(len(points)):
        least = np.inf
        for k in range(len(starts)):
            x, y, z = subtract(row(points, n), row(starts, k))
            along = min(max(dot((x, y, z), row(axes, k)) / length2[k], 0.0), 1.0)
            away = (x - along * axes[k, 0], y - along * axes[k, 1], z - along * axes[k, 2])
            least = min(least, length(away) - thickness[k] - along * growth[k])
        values[n] = least
