"""Planar loops of lines and arcs, as in CAD sketches, with offset directions."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Points = NDArray[np.float64]

WIDEST_CHORD = 0.5  # largest angle of a chord, 29°, regardless of the tolerance, since CAD kernels bound both


class Loop(NamedTuple):
    """A counterclockwise loop of k points."""

    points: Points  # (k, 2) positions
    outward: Points  # (k, 2) offset directions: point + d · outward is the point of the loop offset by d

    def offset(self, distance: float) -> Points:
        """Return the points of the offset loop, (k, 2)."""
        return self.points + distance * self.outward

    def moved(self, by: ArrayLike, *, turn: float = 0.0) -> "Loop":
        """Rotate about the origin, then translate."""
        rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        return Loop(self.points @ rotation + np.asarray(by), self.outward @ rotation)


def chords(radius: float, angle: float, *, tolerance: float) -> int:
    """Return the number of chords of an arc that keeps them within the tolerance of it."""
    widest = min(WIDEST_CHORD, 2 * np.arccos(max(1 - tolerance / max(radius, 1e-12), 0.0)))
    return max(int(np.ceil(angle / widest - 1e-9)), 1)


def circle(radius: float, *, tolerance: float) -> Loop:
    """Return a circle about the origin."""
    count = max(chords(radius, 2 * np.pi, tolerance=tolerance), 3)
    angle = 2 * np.pi * np.arange(count) / count
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Loop(radius * outward, outward)


def rounded(corners: ArrayLike, radii: ArrayLike, *, tolerance: float) -> Loop:
    """Return a counterclockwise polygon with arcs at corners with a radius, each of at most half of a side."""
    places = np.asarray(corners, np.float64)
    arcs = np.broadcast_to(np.asarray(radii, np.float64), len(places))
    back, ahead = np.roll(places, 1, axis=0) - places, np.roll(places, -1, axis=0) - places
    sides = np.linalg.norm(back, axis=1), np.linalg.norm(ahead, axis=1)
    back, ahead = back / sides[0][:, None], ahead / sides[1][:, None]
    half = 0.5 * np.arccos(np.clip((back * ahead).sum(axis=1), -1, 1))
    bend = np.sign(ahead[:, 0] * back[:, 1] - ahead[:, 1] * back[:, 0])
    arcs = np.minimum(arcs, 0.49 * np.minimum(*sides) * np.tan(half))
    points, outward = [], []
    for k, corner in enumerate(places):
        bisector = back[k] - ahead[k]
        out = np.array([-bisector[1], bisector[0]]) / np.linalg.norm(bisector)
        if arcs[k] <= 0:
            points.append(corner[None])
            outward.append(out[None] / np.sin(half[k]))
            continue
        center = corner - bend[k] * out * arcs[k] / np.sin(half[k])
        turn = np.pi - 2 * half[k]
        steps = np.linspace(-0.5, 0.5, chords(arcs[k], turn, tolerance=tolerance) + 1) * turn * bend[k]
        cos, sin = np.cos(steps)[:, None], np.sin(steps)[:, None]
        normal = cos * out + sin * np.array([-out[1], out[0]])
        points.append(center + bend[k] * arcs[k] * normal)
        outward.append(normal)
    return Loop(np.concatenate(points), np.concatenate(outward))


def sketch(size: float, *, tolerance: float, rng: np.random.Generator) -> Loop:
    """Return a random outline of about `size`, as of a printed or milled part."""
    kind = rng.integers(6)
    w, h = size * rng.uniform(0.5, 1.0, 2)
    a, b = w * rng.uniform(0.3, 0.6), h * rng.uniform(0.3, 0.6)
    if kind == 0:
        return circle(size, tolerance=tolerance)
    if kind == 1:
        corners = [(-w, -h), (w, -h), (w, h), (-w, h)]
    elif kind == 2:
        corners = [(-w, -h), (w, -h), (w, -h + b), (-w + a, -h + b), (-w + a, h), (-w, h)]
    elif kind == 3:
        corners = [(-w, -h), (w, -h), (w, h), (w - a, h), (w - a, -h + b), (-w + a, -h + b), (-w + a, h), (-w, h)]
    elif kind == 4:
        count, inner = 2 * int(rng.integers(3, 20)), rng.uniform(0.6, 0.92)
        angle = 2 * np.pi * np.arange(count) / count
        reach = size * np.where(np.arange(count) % 2, inner, 1.0)
        corners = list(np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1))
    else:
        count = int(rng.integers(3, 9))
        angle = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
        corners = list(size * np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(0.7, 1, (count, 1)))
    radii = size * rng.choice([0.0, 0.03, 0.1, 0.3], len(corners) if rng.random() < 0.5 else 1)
    return with_points(rounded(corners, radii, tolerance=tolerance), rng=rng)


def with_points(loop: Loop, *, rng: np.random.Generator) -> Loop:
    """Insert vertices on a few sides, some of them close together, as neighbouring faces leave them there."""
    count = int(rng.choice([0, 0, 1, 4, 12]))
    points, outward = loop
    for _ in range(count):
        gaps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
        k = int(gaps.argmax())
        share = float(rng.choice([0.5, rng.uniform(0.05, 0.95), 10 ** rng.uniform(-2.5, -1)]))
        n = (k + 1) % len(points)
        line = (points[n] - points[k]) / gaps[k]
        points = np.insert(points, k + 1, points[k] + share * (points[n] - points[k]), axis=0)
        outward = np.insert(outward, k + 1, np.array([line[1], -line[0]]), axis=0)
    return Loop(points, outward)
