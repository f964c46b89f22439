"""Multithreaded conjugate gradients for three right-hand sides with warm starts.

Methods that solve a sequence of similar systems start from the previous solution, so a few iterations suffice for each
system. The solvers in `sparse_solvers` start from zero.
"""

from functools import partial

import numpy as np

from cascadenorm.mesh import Csr, Floats, Vectors, kernel, parallel_for

MOST_ITERATIONS = 400  # for one system; the next one continues from its result
SUM_BLOCK = 1024
"""Rows summed sequentially, so that results do not depend on the number of threads."""
LEAST_BLOCKS = 8
"""Smallest number of blocks for a thread."""


def conjugate_gradients(pattern: Csr, values: Floats, right: Vectors, x: Vectors, bound: float, most: int) -> bool:
    """Improve x, (n, 3), in place until the sum of squared residuals is at most `bound`; return whether this succeeded.

    At least one iteration is made, so that sequences with small steps converge, and at most `most`. The preconditioner
    is the diagonal, which the pattern must include. The three columns share their step sizes, so the result is
    equivariant under rotation.
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
    """Compute the initial residual, the inverse diagonal and the sums of `_advance`."""
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
    """Make the preconditioned residual conjugate to the previous directions."""
    rows = slice(start * SUM_BLOCK, stop * SUM_BLOCK)
    weights, descents, directions = inverse[rows], residual[rows], direction[rows]
    for i in range(len(weights)):
        for d in range(3):
            directions[i, d] = weights[i] * descents[i, d] + share * directions[i, d]


@kernel
def _multiply(
    start: int, stop: int, pattern: Csr, values: Floats, direction: Vectors, image: Vectors, sums: Floats
) -> None:
    """Multiply the direction by the matrix, and sum its curvature."""
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
    """Take a step along the direction; sum the squared residuals, plain and divided by the diagonal."""
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
