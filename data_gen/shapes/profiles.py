"""Profiles as two-dimensional distance fields, and their extrusions and revolutions."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.data_gen.shapes.fields import Blend, DistanceField, Values, computed, intersection, norm
from cascadenorm.mesh import Floats, Vectors, kernel

Profile = Callable[[NDArray[np.float64]], Values]  # (n, 2) positions to signed distances


def polygon(corners: ArrayLike) -> Profile:
    """Return a simple polygon of either orientation, with exact distances."""
    return computed(_polygon, np.array(corners, np.float64, order="C"))


def gear(*, teeth: int, radius: float, depth: float, slope: float) -> Profile:
    """Return a toothed wheel; `slope` ranges from 0 (a sine) to large values (square teeth)."""

    def distance(points: NDArray[np.float64]) -> Values:
        angle = np.arctan2(points[:, 1], points[:, 0])
        wave = np.sin(teeth * angle)
        rim = radius + 0.5 * depth * (np.clip(slope * wave, -1, 1) if slope > 0 else wave)
        steepness = 1 + (0.25 * depth * teeth * max(slope, 1) / radius) ** 2
        return np.asarray((norm(points) - rim) / np.sqrt(steepness))

    return distance


def lobed(*, radii: Values) -> Profile:
    """Return a smooth closed curve whose radius is a Fourier series: mean, then cosine and sine of each order."""

    def distance(points: NDArray[np.float64]) -> Values:
        angle = np.arctan2(points[:, 1], points[:, 0])
        rim, slope = np.full(len(points), radii[0]), np.zeros(len(points))
        for order in range(1, (len(radii) + 1) // 2):
            a, b = radii[2 * order - 1], radii[2 * order]
            rim += a * np.cos(order * angle) + b * np.sin(order * angle)
            slope += order * (b * np.cos(order * angle) - a * np.sin(order * angle))
        return np.asarray((norm(points) - rim) / np.sqrt(1 + (slope / np.maximum(rim, 0.1)) ** 2))

    return distance


def extruded(profile: Profile, *, half_height: float, blend: Blend = "sharp", radius: float = 0.0) -> DistanceField:
    """Extrude a profile along z. The two boundaries are sharp, rounded or chamfered."""

    def side(points: Vectors) -> Values:
        return profile(points[:, :2])

    def caps(points: Vectors) -> Values:
        return np.asarray(np.abs(points[:, 2]) - half_height)

    return intersection(side, caps, blend=blend, radius=radius)


def revolved(profile: Profile) -> DistanceField:
    """Revolve a profile, given in radius and height, about the z axis."""
    return lambda points: profile(np.stack([norm(points[:, :2]), points[:, 2]], axis=1))


@kernel
def _polygon(points: Vectors, corners: Floats, values: Floats) -> None:
    count = len(corners)
    for n in range(len(points)):
        nearest, inside = np.inf, False
        for k in range(count):
            ax, ay = corners[k, 0], corners[k, 1]
            ex, ey = corners[(k + 1) % count, 0] - ax, corners[(k + 1) % count, 1] - ay
            x, y = points[n, 0] - ax, points[n, 1] - ay
            along = min(max((x * ex + y * ey) / (ex * ex + ey * ey), 0.0), 1.0)
            nearest = min(nearest, (x - along * ex) ** 2 + (y - along * ey) ** 2)
            if (ay <= points[n, 1]) != (ay + ey <= points[n, 1]):
                inside ^= (ex * y - ey * x > 0) == (ey > 0)
        values[n] = -np.sqrt(nearest) if inside else np.sqrt(nearest)
