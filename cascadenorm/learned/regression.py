"""One stage of the cascade at run time: nearest cluster centre, that cluster's network, the true normal."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cascadenorm.learned.descriptors import DESCRIPTORS, Stack, pose_free
from cascadenorm.mesh import Mesh, Vectors, over, unit

Array = NDArray[np.float32]
BLOCK = 4096
"""Faces to a matrix product: always the same blocks, whatever the threads."""


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Per-cluster networks with one hidden layer, from the pose-free descriptor of a face to its normal.

    A network puts out one coefficient for each filtered normal of the face; their weighted sum, at unit length, is
    the answer, which therefore turns with the mesh.

    Parameters
    ----------
    descriptor : "B" or "B+G", which filtered normals it reads
    mean, scale : (d,) by which the descriptor is standardised: (x - mean) * scale
    centers : (c, d) cluster centres, among standardised descriptors
    weight1, bias1 : (c, d, h) and (c, h), hidden layer, tanh
    weight2, bias2 : (c, h, k) and (c, k), coefficients of the k normals
    """

    descriptor: str
    mean: Array
    scale: Array
    centers: Array
    weight1: Array
    bias1: Array
    weight2: Array
    bias2: Array

    def arrays(self) -> dict[str, Array]:
        """Return everything but the descriptor's name, by field."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name != "descriptor"}

    def stack(self, mesh: Mesh) -> Stack:
        """Return the filtered normals that this stage reads, (m, k, 3)."""
        return DESCRIPTORS[self.descriptor](mesh)

    def normals(self, stack: Stack) -> Vectors:
        """Regress the true normal of each face from its filtered normals.

        Parameters
        ----------
        stack : (m, k, 3)

        Returns
        -------
        (m, 3) float64, unit; where the weighted sum vanishes, the face's own normal
        """
        out = np.empty((len(stack), 3))
        with threadpool_limits(1):  # the threads are ours, over faces; so a product's bytes do not depend on them
            over(-(-len(stack) // BLOCK), self._blocks, stack, out, smallest=1)
        return out

    def _blocks(self, start: int, stop: int, stack: Stack, out: Vectors) -> None:
        for block in range(start, stop):
            rows = slice(block * BLOCK, (block + 1) * BLOCK)
            out[rows] = self._block_normals(stack[rows])

    def _block_normals(self, stack: Stack) -> Vectors:
        x = self.standardised(stack)
        cluster = self.cluster(x)
        total = np.empty((len(x), 3))
        for c in range(len(self.centers)):
            mine = cluster == c
            hidden = np.tanh(x[mine] @ self.weight1[c] + self.bias1[c])
            coefficients = hidden @ self.weight2[c] + self.bias2[c]
            total[mine] = np.einsum("mk,mkd->md", coefficients, stack[mine])
        return unit(total, otherwise=stack[:, 0])

    def standardised(self, stack: Stack) -> Array:
        """Return the descriptors as centres and networks take them, (m, d)."""
        return (pose_free(stack) - self.mean) * self.scale

    def cluster(self, x: Array) -> NDArray[np.intp]:
        """Return the number of the nearest centre of each standardised descriptor."""
        return np.argmin((self.centers**2).sum(axis=1) - 2 * x @ self.centers.T, axis=1)
