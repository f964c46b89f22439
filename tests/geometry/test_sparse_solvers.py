"""Direct and iterative solvers give the solution that numpy gives."""

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve
from shapes import icosphere, noisy

from cascadenorm.geometry import sparse_solvers
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.geometry.sparse_solvers import (
    Factorisation,
    conjugate_gradients,
    solve_once,
    solve_preconditioned,
    solver,
    solver_of_steps,
)
from cascadenorm.mesh import Csr, MeshError

MESH = noisy(icosphere(3), 0.2)
LAPLACIAN = cotangent_laplacian(MESH)
MATRIX = sparse.csr_array(sparse.diags_array(LAPLACIAN.mass) + 0.01 * LAPLACIAN.stiffness)
RIGHT = np.random.default_rng(0).normal(size=(642, 3))


def test_factorisation_solves_one_and_several_right_hand_sides():
    expected = np.linalg.solve(MATRIX.toarray(), RIGHT)
    factorisation = Factorisation(MATRIX, MESH.vertices)
    np.testing.assert_allclose(factorisation.solve(RIGHT), expected, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(factorisation.solve(RIGHT[:, 0]), expected[:, 0], rtol=1e-10, atol=1e-12)


def test_nested_dissection_orders_each_unknown_once_and_fills_less_than_the_given_order():
    factorisation = Factorisation(MATRIX, MESH.vertices)
    assert (np.sort(factorisation.order) == np.arange(642)).all()
    shuffled = np.random.default_rng(0).permutation(642)
    natural = sparse.linalg.splu(sparse.csc_array(MATRIX[shuffled][:, shuffled]), permc_spec="NATURAL")
    assert factorisation.factors.L.nnz < 0.5 * natural.L.nnz


def test_unknowns_in_one_place_are_ordered_too():
    factorisation = Factorisation(MATRIX, np.zeros((642, 3)))
    np.testing.assert_allclose(MATRIX @ factorisation.solve(RIGHT), RIGHT, atol=1e-10)


def test_conjugate_gradients_agree_and_take_over_when_the_matrix_is_huge(monkeypatch):
    expected = Factorisation(MATRIX, MESH.vertices).solve(RIGHT)
    inverse = 1 / MATRIX.diagonal()
    found = solve_preconditioned(MATRIX, RIGHT, lambda r: inverse * r)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(solve_once(MATRIX, RIGHT), expected, rtol=1e-7, atol=1e-8)
    monkeypatch.setattr(sparse_solvers, "DIRECT_LIMIT", 10)
    monkeypatch.setattr(sparse_solvers, "Factorisation", None)
    np.testing.assert_allclose(solver(MATRIX, MESH.vertices)(RIGHT), expected, rtol=1e-7, atol=1e-8)


def test_a_step_of_few_iterations_is_iterated_and_another_factorised_once(monkeypatch):
    made = []

    class Counted(Factorisation):
        def __init__(self, matrix, positions):
            made.append(matrix)
            super().__init__(matrix, positions)

    expected = Factorisation(MATRIX, MESH.vertices).solve(RIGHT)
    monkeypatch.setattr(sparse_solvers, "Factorisation", Counted)
    solve = solver_of_steps(MATRIX, MESH.vertices)
    np.testing.assert_allclose(solve(RIGHT), expected, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(solve(RIGHT[:, :1]), expected[:, :1], rtol=1e-7, atol=1e-8)
    assert not made
    monkeypatch.setattr(sparse_solvers, "FEW", 3)
    solve = solver_of_steps(MATRIX, MESH.vertices)
    for factor in (1, 2):
        np.testing.assert_allclose(solve(factor * RIGHT), factor * expected, rtol=1e-7, atol=1e-8)
    assert len(made) == 1


def test_a_singular_matrix_is_refused_in_words():
    with pytest.raises(MeshError, match="no single solution"):
        Factorisation(sparse.csr_array(np.diag([1.0, 0.0, 1.0])), np.eye(3))


def test_right_hand_side_is_not_written():
    right = RIGHT.copy()
    Factorisation(MATRIX, MESH.vertices).solve(right)
    assert (right == RIGHT).all()


PATTERN = Csr(MATRIX.indptr.astype(np.int64), MATRIX.indices.astype(np.int32))
EXACT = spsolve(MATRIX.tocsc(), RIGHT)
NEAR = EXACT + 1e-3 * np.random.default_rng(1).normal(size=EXACT.shape)


def improved(start, *, bound, right=RIGHT, most=1000):
    found = start.copy()
    conjugate_gradients(PATTERN, MATRIX.data, right, found, bound, most)
    return found


@pytest.mark.parametrize("start", [np.zeros_like(RIGHT), NEAR], ids=["zero", "near"])
def test_solution_from_any_start_has_the_residual_asked_for(start):
    for bound in (1e-8, 1e-20):
        found = improved(start, bound=bound)
        assert ((RIGHT - MATRIX @ found) ** 2).sum() <= bound * (1 + 1e-6)
    np.testing.assert_allclose(found, EXACT, rtol=1e-8, atol=1e-9)


def test_zero_right_hand_side():
    zero = np.zeros_like(RIGHT)
    np.testing.assert_array_equal(improved(zero, bound=0.0, right=zero), zero)


@pytest.mark.parametrize("limits", [{"bound": np.inf}, {"bound": 0.0, "most": 2}], ids=["loose", "few iterations"])
def test_a_sequence_of_short_solutions_goes_on_to_converge(limits):
    found = NEAR
    for _ in range(1000):
        found = improved(found, **limits)
    np.testing.assert_allclose(found, EXACT, rtol=1e-5, atol=1e-6)


def test_columns_are_one_system_that_turns_with_its_right_hand_side():
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    turned = improved(NEAR @ turn, bound=1e-4, right=RIGHT @ turn)
    np.testing.assert_allclose(turned, improved(NEAR, bound=1e-4) @ turn, atol=1e-12)
