import numpy as np
import pytest
import reference
from shapes import cube, grid, icosphere, mean_angle, noisy

from cascadenorm.baselines.edge_operators import edge_coefficients, edge_quads
from cascadenorm.baselines.l0 import _assemble, edge_system, l0
from cascadenorm.geometry.conjugate_gradients import conjugate_gradients
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
