"""Direct and iterative solvers for sparse symmetric positive definite systems.

The unknowns belong to points in space (vertices or faces). They are ordered by nested dissection of these positions,
which for surfaces gives less fill-in than minimum degree. BLAS runs on one thread, so that solutions do not depend on
the number of threads. Methods that solve a sequence of similar systems start `conjugate_gradients` from the previous
solution, so a few iterations suffice for each system.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import scipy

from cascadenorm.mesh import Csr, Floats, Ints, Ints32, MeshError, Vectors, kernel, one_blas_thread, parallel_for
from cascadenorm.mesh.vectors import add, dot, row, scaled, subtract

DIRECT_LIMIT = 1_000_000  # unknowns of a factorised matrix with about 7 entries a row: about 2 GB of factors
DENSE_LIMIT = 10_000_000  # entries of a factorised matrix of two or three rings: about 3 GB of factors
LEAF_UNKNOWNS = 8  # unknowns that are not split further
FEW = 300  # iterations of conjugate gradients, about as expensive as a factorisation
SOLVER_TOLERANCE = 1e-11  # relative residual of the iterative solutions
MOST_ITERATIONS = 400  # for one system; the next one continues from its result
SUM_BLOCK = 1024  # rows summed sequentially, so that results do not depend on the number of threads
LEAST_BLOCKS = 8  # smallest number of blocks for a thread


class Factorisation:
    """A factorised symmetric positive definite matrix of unknowns at (n, 3) positions; MeshError if it is singular."""

    def __init__(self, matrix: Any, positions: Floats) -> None:
        assert positions.shape == (matrix.shape[0], 3)
        matrix = scipy.sparse.csr_array(matrix)
        self.order = np.empty(len(positions), np.int64)
        _nested_dissection(matrix.indptr, matrix.indices, np.ascontiguousarray(positions), LEAF_UNKNOWNS, self.order)
        ordered = scipy.sparse.csc_array(matrix[self.order][:, self.order])
        try:
            with one_blas_thread(scipy.sparse.linalg):
                self.factors = scipy.sparse.linalg.splu(
                    ordered, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
                )
        except RuntimeError as error:  # SuperLU: exactly singular
            raise MeshError(
                f"the equations of this method have no single solution for these {len(positions)} unknowns ({error}): "
                "some faces have no area, or a component has no fixed vertex; remove them, or choose another method"
            ) from None

    def solve(self, right: Floats) -> Floats:
        """Return the solution for one right-hand side (n,) or for several, (n, c)."""
        solution = np.empty(right.shape)
        with one_blas_thread(scipy.sparse.linalg):
            solution[self.order] = self.factors.solve(right[self.order])
        return solution


def solver(matrix: Any, positions: Floats) -> Callable[[Floats], Floats]:
    """Return a solver for a one-ring matrix: a factorisation, or conjugate gradients above DIRECT_LIMIT unknowns."""
    if len(positions) <= DIRECT_LIMIT:
        return Factorisation(matrix, positions).solve
    return lambda right: solve_once(matrix, right)


def solver_of_steps(matrix: Any, positions: Floats) -> Callable[[Floats], Floats]:
    """Return a solver for the matrix of an implicit step, for right-hand sides (n, c) with at most 3 columns.

    It uses multithreaded conjugate gradients, which need few iterations if the step is short. If they need more than
    FEW, this and all further right-hand sides are solved as by `solver`.
    """
    pattern, prepared = Csr.of(matrix), list[Callable[[Floats], Floats]]()

    def solve(right: Floats) -> Floats:
        if not prepared:
            columns, solution = np.zeros((2, len(right), 3))
            columns[:, : right.shape[1]] = right
            bound = SOLVER_TOLERANCE**2 * np.square(right).sum()
            if conjugate_gradients(pattern, matrix.data, columns, solution, bound, FEW):
                return solution[:, : right.shape[1]]
            prepared.append(solver(matrix, positions))
        return prepared[0](right)

    return solve


def solver_of_rings(
    matrix: Any, root: Any, mass: Floats, positions: Floats, *, order: int
) -> Callable[[Floats], Floats]:
    """Return a solver for a matrix of two or three rings, which is approximately root (M⁻¹ root)^(order - 1).

    Matrices up to DENSE_LIMIT entries are factorised. Factors of larger ones would need too much memory; there, a
    solver for the one-ring matrix `root` preconditions conjugate gradients.
    """
    if matrix.nnz <= DENSE_LIMIT:
        return Factorisation(matrix, positions).solve
    solve_root = solver(root, positions)

    def precondition(residual: Floats) -> Floats:
        residual = solve_root(residual)
        for _ in range(order - 1):
            residual = solve_root(mass * residual)
        return residual

    return lambda right: solve_preconditioned(matrix, right, precondition)


def solve_once(matrix: Any, right: Floats) -> Floats:
    """Solve a single system by conjugate gradients with the diagonal as preconditioner."""
    inverse_diagonal = 1.0 / matrix.diagonal()
    return solve_preconditioned(matrix, right, lambda residual: inverse_diagonal * residual)


def solve_preconditioned(matrix: Any, right: Floats, precondition: Callable[[Floats], Floats]) -> Floats:
    """Solve for each column of `right` with scipy's preconditioned conjugate gradients, starting from zero.

    The relative residual is at most 1e-11.
    """
    if right.ndim == 2:
        return np.stack([solve_preconditioned(matrix, column, precondition) for column in right.T.copy()], axis=1)
    with one_blas_thread(scipy.sparse.linalg):
        solution, unsolved = scipy.sparse.linalg.cg(
            matrix, right, rtol=SOLVER_TOLERANCE, M=scipy.sparse.linalg.LinearOperator(matrix.shape, precondition)
        )
        if unsolved:
            raise MeshError(
                f"conjugate gradients did not converge in {unsolved} iterations: use a smaller step or weight"
            )
    return np.asarray(solution)


@kernel
def _nested_dissection(indptr: Ints, indices: Ints32, positions: Vectors, leaf: int, order: Ints) -> None:
    """Order unknowns recursively so that the two halves of a box precede the separator between them."""
    n = len(positions)
    for i in range(n):
        order[i] = i
    half = np.full(n, -1, np.int64)  # label of the box half that each unknown was last put in
    separator = np.empty(n, np.int64)
    boxes = [(0, n)]
    label = 0
    while len(boxes) > 0:
        first, last = boxes.pop()
        if last - first <= leaf:
            continue
        # split the box at the median across its longest side
        inside = order[first:last].copy()
        low, high = positions[inside[0]].copy(), positions[inside[0]].copy()
        for i in inside:
            for d in range(3):
                low[d], high[d] = min(low[d], positions[i, d]), max(high[d], positions[i, d])
        axis = np.argmax(high - low)
        if not high[axis] > low[axis]:
            continue
        along = np.empty(len(inside))
        for k in range(len(inside)):
            along[k] = positions[inside[k], axis]
        inside = inside[np.argsort(along, kind="mergesort")]
        middle = len(inside) // 2

        # mark the two halves with labels that are unique to this box
        label += 2
        for k in range(len(inside)):
            half[inside[k]] = label if k < middle else label + 1

        # unknowns of the lower half with neighbours in the upper half form the separator and come last
        end, cut = first, 0
        for i in inside[:middle]:
            touches = False
            for k in range(indptr[i], indptr[i + 1]):
                if half[indices[k]] == label + 1:
                    touches = True
                    break
            if touches:
                separator[cut] = i
                cut += 1
            else:
                order[end] = i
                end += 1
        split = end
        for i in inside[middle:]:
            order[end] = i
            end += 1
        for k in range(cut):
            order[end + k] = separator[k]
        boxes.append((first, split))
        boxes.append((split, end))


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
            rest = row(right, i)
            for k in range(pattern.indptr[i], pattern.indptr[i + 1]):
                rest = subtract(rest, scaled(values[k], row(x, pattern.indices[k])))
                if pattern.indices[k] == i:
                    inverse[i] = 1.0 / values[k]
            residual[i, 0], residual[i, 1], residual[i, 2] = rest
            size = dot(rest, rest)
            squared += size
            energy += inverse[i] * size
        sums[block, 0], sums[block, 1] = squared, energy


@kernel
def _turn(start: int, stop: int, inverse: Floats, residual: Vectors, share: float, direction: Vectors) -> None:
    """Make the preconditioned residual conjugate to the previous directions."""
    rows = slice(start * SUM_BLOCK, stop * SUM_BLOCK)
    weights, descents, directions = inverse[rows], residual[rows], direction[rows]
    for i in range(len(weights)):
        turned = add(scaled(weights[i], row(descents, i)), scaled(share, row(directions, i)))
        directions[i, 0], directions[i, 1], directions[i, 2] = turned


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
            product = (0.0, 0.0, 0.0)
            for k in range(starts[i], starts[i + 1]):
                product = add(product, scaled(values[k], row(direction, pattern.indices[k])))
            images[i, 0], images[i, 1], images[i, 2] = product
            curvature += dot(product, row(directions, i))
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
            places[i, 0], places[i, 1], places[i, 2] = add(row(places, i), scaled(step, row(directions, i)))
            rest = subtract(row(residuals, i), scaled(step, row(images, i)))
            residuals[i, 0], residuals[i, 1], residuals[i, 2] = rest
            size = dot(rest, rest)
            squared += size
            energy += weights[i] * size
        sums[block, 0], sums[block, 1] = squared, energy
