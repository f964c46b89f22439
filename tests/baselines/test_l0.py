"""L0 minimisation equals its formulas and returns noisy flat sides to planes."""

import numpy as np
import pytest
import reference
from hypothesis import given
from hypothesis import strategies as st
from shapes import cube, grid, icosphere, mean_angle, noisy

from cascadenorm.baselines.l0 import _assemble, edge_coefficients, edge_quads, edge_system, l0, mean_dihedral
from cascadenorm.geometry.sparse_solvers import conjugate_gradients
from cascadenorm.mesh import Mesh

OPERATORS = pytest.mark.parametrize("operator", ["area", "cotan"])


@OPERATORS
def test_a_noisy_cube_returns_to_six_flat_sides(operator):
    clean = cube(10)
    rough = noisy(clean, 0.15, seed=3)
    smooth = rough.moved(l0(rough, operator=operator))
    assert mean_angle(rough, clean) > 15
    assert mean_angle(smooth, clean) < 1.5
    own_side = np.abs(smooth.face_normals).max(axis=1)
    assert np.quantile(own_side, 0.1) > np.cos(np.radians(2))
    edges = np.abs(clean.vertices).max(axis=1) == 1
    assert np.abs(np.abs(smooth.vertices[edges]).max(axis=1) - 1).mean() < 0.1 * clean.mean_edge_length


@OPERATORS
def test_system_and_its_solution_equal_dense_ones(operator):
    rough = noisy(icosphere(1), 0.2)
    vertices = noisy(rough, 0.1, seed=2).vertices.copy()
    quads = edge_quads(rough.topology)
    coefficients = edge_coefficients(vertices, quads, operator)
    price, alpha, beta = 0.01, 0.3, 0.7
    matrix, right = reference.l0_system(
        rough.vertices, vertices, quads, coefficients, alpha=alpha, beta=beta, price=price
    )
    system = edge_system(quads, len(vertices))
    values, ours = np.empty(len(system.pattern.indices)), np.empty_like(vertices)
    _assemble(system, rough.vertices, vertices, coefficients, alpha, beta, price, values, ours)
    dense = np.zeros_like(matrix)
    dense[system.pattern.rows, system.pattern.indices] = values
    np.testing.assert_allclose(dense, matrix, atol=1e-12)
    np.testing.assert_allclose(ours, right, atol=1e-12)
    conjugate_gradients(system.pattern, values, ours, vertices, 1e-26, 500)
    np.testing.assert_allclose(vertices, np.linalg.solve(matrix, right), atol=1e-12)


@OPERATORS
def test_bends_that_cost_nothing_all_stay(operator):
    rough = noisy(icosphere(2), 0.2)
    np.testing.assert_allclose(l0(rough, operator=operator, sparsity=0, regularity=0), rough.vertices, atol=1e-6)


@OPERATORS
def test_a_plane_and_a_cube_are_fixed(operator):
    for mesh, bound in ((grid(8, 8), 1e-12), (cube(6), 0.05)):
        assert np.abs(l0(mesh, operator=operator) - mesh.vertices).max() < bound * mesh.mean_edge_length


def test_boundaries_unused_vertices_and_degenerate_faces_do_no_harm():
    sheet = noisy(grid(8, 8), 0.1)
    vertices = np.concatenate([sheet.vertices, [[5.0, 5, 5]]])
    dirty = Mesh(vertices, np.concatenate([sheet.faces, [[0, 0, 1], [0, 1, 40]]]))
    for operator in ("area", "cotan"):
        out = l0(dirty, operator=operator)
        assert np.isfinite(out).all() and (out[-1] == 5).all()
    assert (l0(Mesh(np.ones((3, 3)), [(0, 1, 2)])) == 1).all()


TWO_FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
QUAD = np.array([[0, 1, 2, 3]], np.int32)


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
