"""Conjugate gradients for symmetric positive definite systems of three columns, on all threads, from any start.

Methods that solve again and again while the solution moves little start from the solution before: a few iterations do
for each system. `sparse_solvers` starts from zero.
"""

from functools import partial

import numpy as np

from cascadenorm.mesh import Csr, Floats, Vectors, kernel, parallel_for

MOST_ITERATIONS = 400  # for one system; the next one starts where they end, so more change nothing
SUM_BLOCK = 1024
"""Rows that are added up in turn, whatever the number of threads, on which the bytes do not depend then."""
LEAST_BLOCKS = 8
"""Blocks for which a thread is worth its start."""


def conjugate_gradients(pattern: Csr, values: Floats, right: Vectors, x: Vectors, bound: float, most: int) -> bool:
    """Improve x, (n, 3), until the sum of the squared residuals is at most `bound`, or for `most` iterations.

    Preconditioned by the diagonal, which the pattern includes. The three columns are one system with common steps: so
    they turn with the mesh. One iteration is made in any case: a sequence with small steps goes on to converge.

    Returns
    -------
    whether the bound was reached
    """
    inverse, residual, image = np.empty(len(x)), np.empty_like(x), np.empty_like(x)
    direction, sums = np.zeros_like(x), np.empty((-(-len(x) // SUM_BLOCK), 2))
    blockwise = partial(parallel_for, len(sums), smallest=LEAST_BLOCKS)
    blockwise(_begin, pattern, values, right, x, inverse, residual, sums)
    before = np.inf
    for iteration in range(most):
        squared, energy = sums.sum(axis=0)
        if energy == 0.0 or (iteration > 0 and squared <= bound):
            return True
        blockwise(_turn, inverse, residual, energy / before, direction)
        blockwise(_multiply, pattern, values, direction, image, sums)
        blockwise(_advance, inverse, direction, image, energy / sums[:, 0].sum(), x, residual, sums)
        before = energy
    return bool(sums[:, 0].sum() <= bound)


@kernel
def _begin(
    start: int,
    stop: int,
    pattern: Csr,
    values: Floats,
    right: Vectors,
    x: Vectors,
    inverse: Floats,
    residual: Vectors,
    sums: Floats,
) -> None:
    """Find the residual of the start, one over the diagonal, and what `_advance` sums."""
    for block in range(start, stop):
        squared = energy = 0.0
        for i in range(block * SUM_BLOCK, min((block + 1) * SUM_BLOCK, len(x))):
            for d in range(3):
                residual[i, d] = right[i, d]
            for k in range(pattern.indptr[i], pattern.indptr[i + 1]):
                for d in range(3):
                    residual[i, d] -= values[k] * x[pattern.indices[k], d]
                if pattern.indices[k] == i:
                    inverse[i] = 1.0 / values[k]
            size = residual[i, 0] ** 2 + residual[i, 1] ** 2 + residual[i, 2] ** 2
            squared += size
            energy += inverse[i] * size
        sums[block, 0], sums[block, 1] = squared, energy


@kernel
def _turn(start: int, stop: int, inverse: Floats, residual: Vectors, share: float, direction: Vectors) -> None:
    """Turn the steepest descent so that it does not undo the steps before."""
    rows = slice(start * SUM_BLOCK, stop * SUM_BLOCK)
    weights, descents, directions = inverse[rows], residual[rows], direction[rows]
    for i in range(len(weights)):
        for d in range(3):
            directions[i, d] = weights[i] * descents[i, d] + share * directions[i, d]


@kernel
def _multiply(
    start: int, stop: int, pattern: Csr, values: Floats, direction: Vectors, image: Vectors, sums: Floats
) -> None:
    """Multiply the direction by the matrix; sum its curvature."""
    for block in range(start, stop):
        rows = slice(block * SUM_BLOCK, (block + 1) * SUM_BLOCK)
        starts, directions, images = pattern.indptr[rows.start :], direction[rows], image[rows]
        curvature = 0.0
        for i in range(len(images)):
            a = b = c = 0.0
            for k in range(starts[i], starts[i + 1]):
                j, value = pattern.indices[k], values[k]
                a += value * direction[j, 0]
                b += value * direction[j, 1]
                c += value * direction[j, 2]
            images[i, 0], images[i, 1], images[i, 2] = a, b, c
            curvature += a * directions[i, 0] + b * directions[i, 1] + c * directions[i, 2]
        sums[block, 0] = curvature


@kernel
def _advance(
    start: int,
    stop: int,
    inverse: Floats,
    direction: Vectors,
    image: Vectors,
    step: float,
    x: Vectors,
    residual: Vectors,
    sums: Floats,
) -> None:
    """Go along the direction to the least residual; sum its squares, and these over the diagonal."""
    for block in range(start, stop):
        rows = slice(block * SUM_BLOCK, (block + 1) * SUM_BLOCK)
        weights, directions, images = inverse[rows], direction[rows], image[rows]
        places, residuals = x[rows], residual[rows]
        squared = energy = 0.0
        for i in range(len(places)):
            for d in range(3):
                places[i, d] += step * directions[i, d]
                residuals[i, d] -= step * images[i, d]
            size = residuals[i, 0] ** 2 + residuals[i, 1] ** 2 + residuals[i, 2] ** 2
            squared += size
            energy += weights[i] * size
        sums[block, 0], sums[block, 1] = squared, energy
