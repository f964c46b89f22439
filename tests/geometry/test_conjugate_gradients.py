import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve
from shapes import icosphere, noisy

from cascadenorm.geometry.conjugate_gradients import conjugate_gradients
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.mesh import Csr

MESH = noisy(icosphere(3), 0.2)
LAPLACIAN = cotangent_laplacian(MESH)
MATRIX = sparse.csr_array(sparse.diags_array(LAPLACIAN.mass) + 0.01 * LAPLACIAN.stiffness)
PATTERN = Csr(MATRIX.indptr.astype(np.int64), MATRIX.indices.astype(np.int32))
RIGHT = np.random.default_rng(0).normal(size=(len(MESH.vertices), 3))
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
