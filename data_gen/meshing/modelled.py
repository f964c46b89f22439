"""Meshes as artists model them: boxes are extruded from boxes, and their quadrilaterals are sculpted and subdivided."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.surface import fit
from cascadenorm.data_gen.shapes.patterns import noise
from cascadenorm.data_gen.shapes.placement import log_uniform, random_direction
from cascadenorm.mesh import Ints, Mesh, Vectors, scatter_add

CAGE_QUADS = 12, 600  # fewest and most quadrilaterals of a cage
STRAIGHT = 0.6  # probability that the next box continues the last one, which forms limbs
WIDTHS = 0.15, 1.5  # of boxes
SCULPTED = 0.1, 0.8  # displacement in mean edge lengths before a subdivision
CUT = 0.25  # share of the surfaces that a plane cuts open
STEPS = np.concatenate([np.eye(3, dtype=np.int64), -np.eye(3, dtype=np.int64)])
AROUND = np.array([[1, 2], [2, 0], [0, 1], [2, 1], [0, 2], [1, 0]])
"""Axes along which the sides of a box extend, in the order of STEPS; their cross product points outwards."""

Quads = NDArray[np.int64]


def modelled_mesh(*, faces: int, rng: np.random.Generator) -> Mesh:
    """Model a surface of about `faces` triangles, closed or cut by a plane; raises UnfitShapeError if it is invalid."""
    possible = [level for level in (1, 2, 3, 4) if CAGE_QUADS[0] <= faces / (2 * 4**level) <= CAGE_QUADS[1]]
    if not possible:
        raise UnfitShapeError(f"no cage of {CAGE_QUADS} quadrilaterals gives {faces} faces")
    levels = int(rng.choice(possible))
    points, quads = _skin(_boxes(round(faces / (2 * 4**levels) / 4), rng), rng)
    fit(Mesh(points, _triangles(points, quads, rng)))
    for _ in range(levels):
        if rng.random() < 0.75:
            points = _sculpted(points, quads, rng)
        points, quads = subdivided(points, quads)
    if rng.random() < CUT:
        heights = points[quads].mean(axis=1) @ random_direction(rng=rng)
        quads = quads[heights < np.quantile(heights, rng.uniform(0.65, 0.95))]
        used, numbers = np.unique(quads, return_inverse=True)
        points, quads = points[used], numbers.reshape(-1, 4)
    return fit(Mesh(points / np.ptp(points, axis=0).max(), _triangles(points, quads, rng)))


def _boxes(count: int, rng: np.random.Generator) -> Ints:
    """Grow a set of boxes on a lattice, (k, 3); half of the sets are mirrored."""
    boxes, step = [(0, 0, 0)], STEPS[0]
    mirrored = rng.random() < 0.5
    while len(boxes) < max(count // (2 if mirrored else 1), 1):
        start = boxes[-1]
        if rng.random() > STRAIGHT:
            start, step = boxes[rng.integers(len(boxes))], STEPS[rng.integers(6)]
        box = tuple(int(x) for x in start + step)
        if box in boxes or (mirrored and box[0] < 0):
            step = STEPS[rng.integers(6)]
        else:
            boxes.append((box[0], box[1], box[2]))
    every = np.array(boxes)
    return np.unique(np.concatenate([every, every * [-1, 1, 1]]), axis=0) if mirrored else every


def _skin(boxes: Ints, rng: np.random.Generator) -> tuple[Vectors, Quads]:
    """Return the surface of boxes of uneven widths, bent smoothly: corners, (n, 3), and quadrilaterals, (q, 4)."""
    filled = {tuple(box) for box in boxes.tolist()}
    found = []
    for step, (one, other) in zip(STEPS, AROUND, strict=True):
        bare = boxes[[tuple(box) not in filled for box in (boxes + step).tolist()]]
        first = bare + np.maximum(step, 0)
        a, b = np.eye(3, dtype=np.int64)[[one, other]]
        found.append(np.stack([first, first + a, first + a + b, first + b], axis=1))
    corners = np.concatenate(found)
    nodes, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    points = np.empty(nodes.shape)
    low, high = np.log(WIDTHS).tolist()
    for axis, along in enumerate(nodes.T):
        widths = np.exp(rng.uniform(low, high, int(np.ptp(along))))
        points[:, axis] = np.concatenate([[0], np.cumsum(widths)])[along - along.min()]
    size = np.ptp(points, axis=0).max()
    bends = [noise(wavelength=rng.uniform(0.4, 1.2) * size, rng=rng) for _ in range(3)]
    shift = np.stack([bend(points) for bend in bends], axis=1)
    return points + rng.uniform(0, 0.35) * size * shift, numbers.reshape(-1, 4)


def _sculpted(points: Vectors, quads: Quads, rng: np.random.Generator) -> Vectors:
    """Displace points smoothly by less than an edge."""
    edge = float(np.linalg.norm(points[quads] - points[np.roll(quads, -1, axis=1)], axis=2).mean())
    patterns = [noise(wavelength=log_uniform((1.5, 6.0), rng=rng) * edge, rng=rng) for _ in range(3)]
    size = edge * log_uniform(SCULPTED, rng=rng)
    return np.asarray(points + size * np.stack([pattern(points) for pattern in patterns], axis=1))


def subdivided(points: Vectors, quads: Quads) -> tuple[Vectors, Quads]:
    """Subdivide a closed surface of quadrilaterals once (Catmull, Clark 1978)."""
    count, middles = len(points), points[quads].mean(axis=1)
    ends = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2)
    edges, of_sides = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    of_sides = of_sides.reshape(quads.shape)
    halves = points[edges].mean(axis=1)
    beside = scatter_add(of_sides.ravel(), np.repeat(middles, 4, axis=0), len(edges))
    valence = np.bincount(quads.ravel(), minlength=count)[:, None]
    around = scatter_add(quads.ravel(), np.repeat(middles, 4, axis=0), count)
    along = scatter_add(edges.ravel(), np.repeat(halves, 2, axis=0), count)
    moved = (around / valence + 2 * along / valence + (valence - 3) * points) / valence
    at_edges, at_middles = count + of_sides, count + len(edges) + np.arange(len(quads))[:, None]
    fine = np.stack([quads, at_edges, np.broadcast_to(at_middles, quads.shape), np.roll(at_edges, 1, axis=1)], axis=2)
    return np.concatenate([moved, (halves + beside / 2) / 2, middles]), fine.reshape(-1, 4)


def _triangles(points: Vectors, quads: Quads, rng: np.random.Generator) -> NDArray[np.int32]:
    """Cut quadrilaterals along the shorter diagonal, along a common direction, from the first corner, or at random."""
    a, b, c, d = (points[quads[:, k]] for k in range(4))
    cut = str(rng.choice(["shorter", "direction", "first", "random"], p=[0.5, 0.25, 0.1, 0.15]))
    direction = random_direction(rng=rng)
    other = {
        "shorter": np.linalg.norm(b - d, axis=1) < np.linalg.norm(a - c, axis=1),
        "direction": np.abs((b - d) @ direction) > np.abs((a - c) @ direction),
        "first": np.zeros(len(quads), bool),
        "random": rng.random(len(quads)) < 0.5,
    }[cut]
    quads = np.where(other[:, None], np.roll(quads, -1, axis=1), quads)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
