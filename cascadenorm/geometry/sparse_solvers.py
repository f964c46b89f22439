"""Direct and iterative solvers for sparse symmetric positive definite systems.

The unknowns belong to points in space (vertices or faces). They are ordered by nested dissection of these positions,
which for surfaces gives less fill-in than minimum degree. BLAS runs on one thread, so that solutions do not depend on
the number of threads.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from cascadenorm.geometry.conjugate_gradients import conjugate_gradients
from cascadenorm.mesh import Csr, Floats, Ints, Ints32, MeshError, Vectors, kernel, one_blas_thread

DIRECT_LIMIT = 1_000_000  # unknowns of a factorised matrix with about 7 entries a row: about 2 GB of factors
DENSE_LIMIT = 10_000_000  # entries of a factorised matrix of two or three rings: about 3 GB of factors
LEAF_UNKNOWNS = 8  # unknowns that are not split further
FEW = 300  # iterations of conjugate gradients, about as expensive as a factorisation
SOLVER_TOLERANCE = 1e-11  # relative residual of the iterative solutions


class Factorisation:
    """A factorised symmetric positive definite matrix, (n, n), of unknowns at (n, 3) positions in space.

    Raises MeshError if the matrix is singular.
    """

    def __init__(self, matrix: Any, positions: Floats) -> None:
        assert positions.shape == (matrix.shape[0], 3)
        matrix = scipy.sparse.csr_array(matrix)
        self.order = np.empty(len(positions), np.int64)
        _nested_dissection(matrix.indptr, matrix.indices, np.ascontiguousarray(positions), LEAF_UNKNOWNS, self.order)
        ordered = scipy.sparse.csc_array(matrix[self.order][:, self.order])
        try:
            with one_blas_thread():
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
        with one_blas_thread():
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
    with one_blas_thread():
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
