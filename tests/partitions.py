"""Partitions whose walls, junction curves and junction points are known."""

import numpy as np

from cascadenorm.data_gen.meshing.partitions import LabelledMesh, Partition, segmented
from cascadenorm.mesh import unit

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
