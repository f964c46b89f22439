"""Sparse symmetric positive definite systems of meshes: one factorisation and many right-hand sides, or few iterations.

The unknowns belong to points in space (vertices or faces). Nested dissection by these positions orders them: for a
surface it leaves less fill than minimum degree and takes a fraction of its time. BLAS runs on one thread here, so
that the bytes of a solution do not depend on how many there are.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from cascadenorm.geometry.conjugate_gradients import conjugate_gradients
from cascadenorm.mesh import Csr, Floats, Ints, Ints32, MeshError, Vectors, kernel, one_blas_thread

DIRECT_LIMIT = 1_000_000  # unknowns of a matrix with about 7 entries a row: some 2 GB of factors
DENSE_LIMIT = 10_000_000  # entries of a matrix of two or three rings that is still factorised: some 3 GB of factors
LEAF_UNKNOWNS = 8  # unknowns that are not split further
FEW = 300  # iterations of conjugate gradients, which take about as long as a factorisation
SOLVER_TOLERANCE = 1e-11  # relative residual of the iterative solutions


class Factorisation:
    """A symmetric positive definite matrix, factorised once.

    Parameters
    ----------
    matrix
        (n, n) scipy sparse; only the symmetric part of its pattern is relied on.
    positions
        (n, 3) where in space the unknowns are.

    Raises
    ------
    MeshError
        The matrix is singular.
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
    """Return a function that solves with a matrix of one ring: factorised, or by conjugate gradients if it is huge."""
    if len(positions) <= DIRECT_LIMIT:
        return Factorisation(matrix, positions).solve
    return lambda right: solve_once(matrix, right)


def solver_of_steps(matrix: Any, positions: Floats) -> Callable[[Floats], Floats]:
    """Return a function that solves with the matrix of an implicit step, for (n, c) with at most 3 columns.

    By conjugate gradients, which take few iterations where the step is short, on all threads. Where they take more
    than FEW, the matrix is factorised as by `solver`, for all further right-hand sides too.
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
    """Return a function that solves with a matrix of two or three rings, which is about root (M⁻¹ root)^(order - 1).

    Middling matrices are factorised. The factors of larger ones would fill too much memory: there only the root, of
    one ring, is factorised, and preconditions conjugate gradients.
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
    """Solve with a matrix that is needed only once, and whose factors would be large."""
    inverse_diagonal = 1.0 / matrix.diagonal()
    return solve_preconditioned(matrix, right, lambda residual: inverse_diagonal * residual)


def solve_preconditioned(matrix: Any, right: Floats, precondition: Callable[[Floats], Floats]) -> Floats:
    """Solve for each column of `right` by preconditioned conjugate gradients, to a relative residual of 1e-11.

    By scipy, from zero, with any matrix and preconditioner.
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
    """Order unknowns so that either half of a box comes before the unknowns that separate the two, recursively."""
    n = len(positions)
    for i in range(n):
        order[i] = i
    half = np.full(n, -1, np.int64)  # which half of which box an unknown was last put in
    separator = np.empty(n, np.int64)
    boxes = [(0, n)]
    label = 0
    while len(boxes) > 0:
        first, last = boxes.pop()
        if last - first <= leaf:
            continue
        # cut the box in half across its longest side, by the number of unknowns
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

        # mark the two halves; labels of boxes differ, so marks of other boxes do not count
        label += 2
        for k in range(len(inside)):
            half[inside[k]] = label if k < middle else label + 1

        # unknowns of the lower half that touch the upper one separate the two, and come last
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
