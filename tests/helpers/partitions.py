"""Partitions: regions that share walls, the surfaces of their label volumes, and the exact walls, curves and points."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cascadenorm.mesh import Bools, Floats, Ints, Mesh, Vectors, unit

NEWTON_STEPS = 20
DIFFERENCE = 1e-5  # for gradients, in the unit of the shapes
AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))  # the cells around an edge of the lattice, in turn


class Partition(NamedTuple):
    """A body divided into regions 1, 2, …; 0 is the outside.

    Parameters
    ----------
    body
        (k, 3) points to (k,), negative inside, near its surface the distance.
    regions
        (k, 3) points to (k, l), one function a region; a point belongs to that of the least.
    """

    body: Callable[[Vectors], Floats]
    regions: Callable[[Vectors], Floats]

    def labels(self, points: Vectors) -> Ints:
        """Return (k,) the region of each point."""
        return np.where(self.body(points) < 0, 1 + self.regions(points).argmin(axis=1), 0)

    def walls(self, points: Vectors, sets: Bools) -> Floats:
        """Return (k, l) functions that vanish where all regions of a set meet, which holds two regions at least.

        Parameters
        ----------
        sets
            (k, l + 1) which regions, the outside first.
        """
        values, inside = self.regions(points), sets[:, 1:]
        first = values[np.arange(len(points)), inside.argmax(axis=1)]
        out = np.where(inside, values - first[:, None], 0.0)
        return np.concatenate([np.where(sets[:, 0], self.body(points), 0.0)[:, None], out], axis=1)

    def gradients(self, points: Vectors, sets: Bools) -> Floats:
        """Return (k, l + 1, 3) the gradients of `walls`."""
        steps = DIFFERENCE * np.eye(3)
        slopes = [self.walls(points + h, sets) - self.walls(points - h, sets) for h in steps]
        return np.stack(slopes, axis=2) / (2 * DIFFERENCE)

    def nearest(self, points: Vectors, sets: Bools) -> Vectors:
        """Return where all regions of a set meet near each point: on a wall, a junction curve or a junction point."""
        for _ in range(NEWTON_STEPS):
            inverse = np.linalg.pinv(self.gradients(points, sets), rcond=1e-3)
            points = points - np.einsum("kij,kj->ki", inverse, self.walls(points, sets))
        return points

    def normals(self, points: Vectors, labels: Ints) -> Vectors:
        """Return (k, 3) the unit normals at points of walls, from the first of the two labels to the second."""
        sets = members(labels, self.regions(points[:1]).shape[1] + 1)
        slopes = self.gradients(self.nearest(points, sets), sets)
        rising = slopes[:, 0] * np.where(labels[:, 0] == 0, -1.0, 1.0)[:, None]  # outward of the body
        low, high = labels.min(axis=1), labels.max(axis=1)
        between = slopes[np.arange(len(points)), high] * np.where(labels[:, 0] == high, 1.0, -1.0)[:, None]
        return unit(np.where((low == 0)[:, None], rising, between))


class LabelledMesh(NamedTuple):
    """Walls between regions as one mesh, of whose edges some have three faces or more.

    Parameters
    ----------
    mesh
        m faces.
    labels
        (m, 2) the region behind each face, and the one that its normal points to.
    """

    mesh: Mesh
    labels: Ints

    def vertex_sets(self, count: int) -> Bools:
        """Return (n, count) which regions meet at each vertex."""
        sets = np.zeros((len(self.mesh.vertices), count), bool)
        sets[np.repeat(self.mesh.faces, 2, axis=1), np.tile(self.labels, 3)] = True
        return sets

    def region(self, label: int) -> Mesh:
        """Return the closed surface of a region, its normals outward; all vertices are kept."""
        behind, ahead = (self.labels == label).T
        return Mesh(self.mesh.vertices, np.concatenate([self.mesh.faces[behind], self.mesh.faces[ahead, ::-1]]))


def members(labels: Ints, count: int) -> Bools:
    """Return (k, count) sets as rows of bool, each of the labels in a row."""
    sets = np.zeros((len(labels), count), bool)
    np.put_along_axis(sets, labels, True, axis=1)
    return sets


def segmented(partition: Partition, *, voxel: float, half: float = 1.0, turn: Vectors | None = None) -> LabelledMesh:
    """Sample a partition on the voxels of a cube about the origin, and mesh its walls.

    Parameters
    ----------
    half
        Half the side of the cube, which the body should not reach.
    turn
        (3, 3) rotation of the lattice.
    """
    axis = np.arange(-half, half + 0.5 * voxel, voxel)
    nodes = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    turn = np.eye(3) if turn is None else turn
    walls = label_nets(partition.labels(nodes @ turn.T).reshape((len(axis),) * 3))
    placed = Mesh((walls.mesh.vertices * voxel - half) @ turn.T, walls.mesh.faces)
    return LabelledMesh(placed, walls.labels)


def label_nets(volume: Ints) -> LabelledMesh:
    """Mesh the walls between labels by surface nets (Gibson 1998), a vertex in each cell whose corners differ.

    Parameters
    ----------
    volume
        (p, q, r); walls that reach its border end there.

    Returns
    -------
    in units of voxels; a vertex is the mean of the middles of its cell's edges whose ends differ
    """
    # Edges of the lattice whose ends differ, and the four cells around each
    shape = np.array(volume.shape) - 1
    total, count = np.zeros((*shape, 3)), np.zeros(shape)
    quads, labels = [], []
    for axis in range(3):
        ends = [np.moveaxis(np.moveaxis(volume, axis, 0)[part], 0, axis) for part in (slice(None, -1), slice(1, None))]
        node = np.argwhere(ends[0] != ends[1])
        pair = np.stack([end[tuple(node.T)] for end in ends], axis=1)
        others = [(axis + 1) % 3, (axis + 2) % 3]
        cells = np.repeat(node[:, None], 4, axis=1)
        cells[:, :, others] -= AROUND
        within = np.asarray(((cells >= 0) & (cells < shape)).all(axis=2))
        middle = node + 0.5 * np.eye(3)[axis]
        for k in range(4):
            cell, mine = tuple(cells[within[:, k], k].T), middle[within[:, k]]
            np.add.at(total, cell, mine)
            np.add.at(count, cell, 1)
        whole = within.all(axis=1)
        quads.append(np.ravel_multi_index(tuple(np.moveaxis(cells[whole], 2, 0)), tuple(shape)))
        labels.append(pair[whole])

    # A vertex in each cell, and each quadrangle cut along its shorter diagonal
    cells, which = np.unique(np.concatenate(quads), return_inverse=True)
    vertices = total.reshape(-1, 3)[cells] / count.reshape(-1)[cells, None]
    around = which.reshape(-1, 4)
    first, second = (np.linalg.norm(vertices[around[:, k]] - vertices[around[:, k + 2]], axis=1) for k in (0, 1))
    around = np.where((first <= second)[:, None], around, np.roll(around, -1, axis=1))
    faces = np.concatenate([around[:, [0, 1, 2]], around[:, [0, 2, 3]]])
    return LabelledMesh(Mesh(vertices, faces), np.tile(np.concatenate(labels), (2, 1)))


TURN = np.linalg.qr(np.random.default_rng(9).normal(size=(3, 3)))[0]
TILT = unit(np.array([[0.3, 0.2, 1.0]]))[0]
CORNERS = 0.5 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) @ TURN


def ball(points):
    """Distance to a ball of radius 0.8."""
    return np.linalg.norm(points, axis=1) - 0.8


def box(half, middle=(0.0, 0.0, 0.0)):
    """Distance to a cube, in the greatest norm."""
    return lambda points: (np.abs(points - np.array(middle)) - half).max(axis=1)


def cells(sites, body):
    """The cells of Voronoi of some sites, within a body."""
    return Partition(body, lambda points: np.square(points[:, None] - sites).sum(axis=2))


HALF_BALLS = Partition(ball, lambda points: (points @ TILT)[:, None] * (1, -1))
FOUR_CELLS = cells(CORNERS, ball)
"""They meet at one point within a ball."""
INNER = box(0.4, (0.4, 0, 0))
CUBE_IN_CUBE = Partition(box(0.8), lambda points: INNER(points)[:, None] * (1, -1))
"""The inner cube has a side on one of the outer cube's."""
PARTITIONS = {"half balls": HALF_BALLS, "four cells": FOUR_CELLS, "cube in cube": CUBE_IN_CUBE}
BALL_VOLUME = 4 / 3 * np.pi * 0.8**3
VOLUMES = {
    "half balls": [BALL_VOLUME / 2] * 2,
    "four cells": [BALL_VOLUME / 4] * 4,
    "cube in cube": [0.8**3, 1.6**3 - 0.8**3],
}
"""Of the regions, without their voxels."""


def walls(name: str, *, voxel: float = 0.1) -> LabelledMesh:
    """Return the walls of a partition, on a lattice that is turned against them."""
    return segmented(PARTITIONS[name], voxel=voxel, half=1.4, turn=TURN)
