"""Conjugate gradients for a sequence of symmetric positive definite systems, each started from the solution before it.

For methods that solve again and again while the solution moves little: a few iterations do for each system.
`sparse_solvers` is for solutions that no guess comes near.
"""

import numpy as np

from cascadenorm.mesh import Csr, Floats, Vectors, kernel

MOST_ITERATIONS = 400  # for one system; the next one starts where they end, so more change nothing


@kernel
def conjugate_gradients(pattern: Csr, values: Floats, right: Vectors, x: Vectors, bound: float, most: int) -> None:
    """Improve x, (n, 3), until the sum of the squared residuals is at most `bound`, or for `most` iterations.

    Preconditioned by the diagonal, which the pattern includes. The three columns are one system with common steps: so
    they turn with the mesh. One iteration is made in any case: a sequence with small steps goes on to converge.
    """
    # residual of the start, and one over the diagonal
    n = len(x)
    inverse, residual, direction, image = np.empty(n), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    for i in range(n):
        for d in range(3):
            residual[i, d], direction[i, d] = right[i, d], 0.0
        for k in range(pattern.indptr[i], pattern.indptr[i + 1]):
            for d in range(3):
                residual[i, d] -= values[k] * x[pattern.indices[k], d]
            if pattern.indices[k] == i:
                inverse[i] = 1.0 / values[k]
    before = np.inf
    for iteration in range(most):
        # stop, or turn the steepest descent so that it does not undo the steps before
        squared = energy = 0.0
        for i in range(n):
            size = residual[i, 0] ** 2 + residual[i, 1] ** 2 + residual[i, 2] ** 2
            squared += size
            energy += inverse[i] * size
        if energy == 0.0 or (iteration > 0 and squared <= bound):
            return
        share = energy / before
        before = energy
        for i in range(n):
            for d in range(3):
                direction[i, d] = inverse[i] * residual[i, d] + share * direction[i, d]

        # go along it to the least residual
        curvature = 0.0
        for i in range(n):
            a = b = c = 0.0
            for k in range(pattern.indptr[i], pattern.indptr[i + 1]):
                j, value = pattern.indices[k], values[k]
                a += value * direction[j, 0]
                b += value * direction[j, 1]
                c += value * direction[j, 2]
            image[i, 0], image[i, 1], image[i, 2] = a, b, c
            curvature += a * direction[i, 0] + b * direction[i, 1] + c * direction[i, 2]
        step = energy / curvature
        for i in range(n):
            for d in range(3):
                x[i, d] += step * direction[i, d]
                residual[i, d] -= step * image[i, d]
