import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from shapes import cube, grid, icosphere, noisy

from cascadenorm.baselines.edge_operators import edge_coefficients, edge_quads, mean_dihedral
from cascadenorm.mesh import Mesh

TWO_FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
QUAD = np.array([[0, 1, 2, 3]], np.int32)
OPERATORS = pytest.mark.parametrize("operator", ["area", "cotan"])


def hinge(angle, *, second=(0.3, -0.7), fourth=(1.1, 1.2), edge=1.5):
    """Two faces at the edge 1-3 along x, whose normals differ by `angle`."""
    (u, v), (s, t) = second, fourth
    return np.array([(0, 0, 0), (u, v, 0), (edge, 0, 0), (s, t * np.cos(angle), t * np.sin(angle))])


@OPERATORS
@given(st.integers(0, 10**6))
def test_vanish_on_flat_quads(operator, seed):
    rng = np.random.default_rng(seed)
    flat = hinge(0, second=(rng.uniform(-1, 2), -rng.uniform(0.1, 2)), fourth=(rng.uniform(-1, 2), rng.uniform(0.1, 2)))
    turned = flat @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + rng.normal(size=3)
    coefficients = edge_coefficients(turned, QUAD, operator)
    np.testing.assert_allclose(coefficients @ turned, 0, atol=1e-12)


@pytest.mark.parametrize("angle", [0.1, 1.0, 2.5, -2.0])
def test_cotangent_operator_measures_the_dihedral_angle(angle):
    vertices = hinge(angle)
    coefficients = edge_coefficients(vertices, QUAD, "cotan")
    size = np.linalg.norm(coefficients @ vertices)
    assert size == pytest.approx(2 * abs(np.sin(angle / 2)) * 1.5, rel=1e-12)


@OPERATORS
def test_kernel_equals_the_printed_formula(operator):
    mesh = noisy(icosphere(1), 0.3)
    quads = edge_quads(mesh.topology)
    twin = reference.area_edge_operator if operator == "area" else reference.cotangent_edge_operator
    expected = [twin(*mesh.vertices[quad]) for quad in quads]
    np.testing.assert_allclose(edge_coefficients(mesh.vertices, quads, operator), expected, rtol=1e-11, atol=1e-12)


@OPERATORS
def test_degenerate_triangles_give_finite_weights(operator):
    for vertices in (hinge(0.0, second=(0.5, 0)), hinge(0.0, second=(0.5, 0), fourth=(0.2, 0)), np.zeros((4, 3))):
        assert np.isfinite(edge_coefficients(vertices, QUAD, operator)).all()


def test_quads_leave_out_boundaries_folds_and_edges_of_three_faces():
    assert sorted(edge_quads(Mesh(hinge(1), TWO_FACES).topology)[0]) == [0, 1, 2, 3]
    vertices = np.random.default_rng(0).normal(size=(6, 3))
    assert len(edge_quads(Mesh(vertices, [(0, 1, 2), (1, 0, 3), (0, 1, 4)]).topology)) == 0
    assert len(edge_quads(Mesh(vertices, [(0, 1, 2), (2, 1, 0)]).topology)) == 0  # the same triangle twice
    assert len(edge_quads(Mesh(vertices, [(0, 0, 1), (0, 1, 2)]).topology)) == 0  # two corners in one vertex


def test_mean_dihedral():
    assert mean_dihedral(grid(3, 4)) == 0
    assert mean_dihedral(Mesh(hinge(2.0), TWO_FACES)) == pytest.approx(2.0, rel=1e-12)
    assert mean_dihedral(cube(2)) == pytest.approx(np.pi / 2 * 24 / 72, rel=1e-12)
