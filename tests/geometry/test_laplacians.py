"""Laplacians equal those of other libraries and have the properties of their definitions."""

import numpy as np
import potpourri3d
import pytest
import robust_laplacian
from hypothesis import given
from hypothesis import strategies as st
from shapes import grid, icosphere, noisy

from cascadenorm.geometry.laplacians import (
    cotangent_laplacian,
    intrinsic_lengths,
    laplacian_of,
    uniform_laplacian,
)
from cascadenorm.mesh import Mesh

SPHERE = icosphere(3)


def jittered_grid(size=12):
    plane = grid(size, size)
    jitter = np.random.default_rng(1).uniform(-0.3, 0.3, plane.vertices.shape) * (1, 1, 0)
    return plane.moved(plane.vertices + np.where(plane.topology.boundary_vertices[:, None], 0, jitter))


def test_cotangent_laplacian_equals_an_independent_one():
    for mesh in (noisy(SPHERE, 0.15), jittered_grid()):
        ours = cotangent_laplacian(mesh)
        theirs = potpourri3d.cotan_laplacian(mesh.vertices, mesh.faces)
        assert abs(ours.stiffness - theirs).max() < 1e-10
        np.testing.assert_allclose(ours.mass, potpourri3d.vertex_areas(mesh.vertices, mesh.faces), rtol=1e-12)


def test_cotangent_laplacian_equals_the_robust_one_on_a_delaunay_mesh():
    ours = cotangent_laplacian(SPHERE)
    stiffness, mass = robust_laplacian.mesh_laplacian(SPHERE.vertices, SPHERE.faces, mollify_factor=0.0)
    assert abs(ours.stiffness - stiffness).max() < 1e-10
    np.testing.assert_allclose(ours.mass, mass.diagonal(), rtol=1e-10)


def test_weights_are_half_the_cotangents_of_the_opposite_angles():
    mesh = Mesh([(0, 0, 0), (2, 0, 0), (0.5, 0.5, 0)], [(0, 1, 2)])  # angles: 45° at 0, arctan(1/3) at 1
    stiffness = cotangent_laplacian(mesh).stiffness.toarray()
    assert stiffness[1, 2] == pytest.approx(-0.5 * 1, abs=1e-14)
    assert stiffness[0, 2] == pytest.approx(-0.5 * 3, abs=1e-14)
    assert stiffness[0, 1] == pytest.approx(+0.5 * 0.5, abs=1e-14)  # obtuse: cot(180° - 45° - 18.4°) = -1/2


@given(st.integers(0, 1000), st.floats(1e-3, 1e3))
def test_algebra_holds_on_every_mesh_and_at_every_scale(seed, scale):
    mesh = noisy(icosphere(1), 0.4, seed=seed)
    laplacian = cotangent_laplacian(mesh, mollification=0)
    dirichlet = np.trace(mesh.vertices.T @ (laplacian.stiffness @ mesh.vertices))
    scaled = cotangent_laplacian(mesh.moved(scale * mesh.vertices), mollification=0)
    assert dirichlet == pytest.approx(2 * mesh.area, rel=1e-9)
    assert laplacian.mass.sum() == pytest.approx(mesh.area, rel=1e-9)
    assert abs(laplacian.stiffness - laplacian.stiffness.T).max() == 0
    np.testing.assert_allclose(laplacian.stiffness.sum(axis=1), 0, atol=1e-11)
    assert np.linalg.eigvalsh(laplacian.stiffness.toarray())[0] > -1e-10
    np.testing.assert_allclose(scaled.stiffness.toarray(), laplacian.stiffness.toarray(), rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(scaled.mass, scale**2 * laplacian.mass, rtol=1e-8)


def test_laplacian_of_linear_functions_vanishes_inside_a_plane():
    plane = jittered_grid()
    inside = ~plane.topology.boundary_vertices
    assert abs(cotangent_laplacian(plane).apply(plane.vertices)[inside]).max() < 1e-12
    assert abs(uniform_laplacian(plane).apply(plane.vertices)[inside]).max() > 0.01


def test_laplacian_of_the_sphere_converges_to_minus_twice_the_curvature_times_the_normal():
    def error(level):
        mesh = icosphere(level)
        laplacian = cotangent_laplacian(mesh)
        residual = -laplacian.apply(mesh.vertices) + 2 * mesh.vertices  # H = 1, n = x
        return mesh.mean_edge_length, np.sqrt((laplacian.mass[:, None] * residual**2).sum())

    h, errors = zip(*(error(level) for level in (2, 3, 4)), strict=True)
    assert errors[-1] < 0.1
    assert np.polyfit(np.log(h), np.log(errors), 1)[0] > 0.9


def test_uniform_laplacian_is_the_mean_of_the_neighbours_less_the_vertex():
    mesh = noisy(SPHERE, 0.3)
    i = 100
    expected = mesh.vertices[mesh.topology.vertex_neighbors.row(i)].mean(axis=0) - mesh.vertices[i]
    np.testing.assert_allclose(-uniform_laplacian(mesh).apply(mesh.vertices)[i], expected, rtol=1e-12)


@pytest.mark.parametrize("weights", ["uniform", "cotan"])
def test_power_times_inverse_mass_is_repeated_application_and_the_bound_holds(weights):
    laplacian = laplacian_of(noisy(icosphere(2), 0.2), weights)
    x = np.random.default_rng(0).normal(size=(162, 2))
    for order in (1, 2, 3):
        direct = laplacian.inverse_mass[:, None] * (laplacian.power(order) @ x)
        np.testing.assert_allclose(direct, laplacian.apply(x, order), rtol=1e-9)
    scale = np.sqrt(laplacian.inverse_mass)
    largest = np.linalg.eigvalsh(scale[:, None] * laplacian.stiffness.toarray() * scale)[-1]
    assert largest <= laplacian.largest <= 3 * largest


DEGENERATE = {
    "a vertex on the opposite side": ([(0, 0, 0), (2, 0, 0), (1, 0, 0), (1, 1, 0)], [(0, 1, 2), (0, 1, 3)]),
    "two vertices in one place": ([(0, 0, 0), (1, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)]),
    "all vertices in one place": ([(0, 0, 0)] * 3, [(0, 1, 2)]),
    "a face that repeats a vertex": ([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2), (0, 0, 1)]),
}


@pytest.mark.parametrize("vertices, faces", DEGENERATE.values(), ids=DEGENERATE.keys())
def test_no_weight_of_a_degenerate_triangle_is_infinite(vertices, faces):
    mesh = Mesh(vertices, faces)
    laplacian = cotangent_laplacian(mesh)
    lengths = intrinsic_lengths(mesh)
    assert (lengths.sum(axis=1) - 2 * lengths.max(axis=1) >= 0.99e-5 * (mesh.mean_edge_length or 1)).all()
    assert abs(laplacian.stiffness.toarray()).max() < 1e6
    assert (laplacian.mass > 0).all()
    np.testing.assert_allclose(laplacian.stiffness.sum(axis=1), 0, atol=1e-9)


def test_lengths_are_the_edges_own_where_nothing_is_degenerate():
    ends = SPHERE.vertices[SPHERE.topology.edges]
    expected = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)[SPHERE.topology.face_edges]
    np.testing.assert_allclose(intrinsic_lengths(SPHERE), expected, rtol=1e-14)


def test_an_edge_of_three_faces_gets_the_weights_of_all_three():
    h = np.sqrt(0.75)
    mesh = Mesh([(0, 0, 0), (1, 0, 0), (0.5, h, 0), (0.5, 0, h), (0.5, -h, 0)], [(0, 1, 2), (0, 1, 3), (1, 0, 4)])
    assert cotangent_laplacian(mesh).stiffness[0, 1] == pytest.approx(-1.5 / np.sqrt(3))


def test_a_vertex_without_a_face_has_no_mass_and_no_laplacian():
    mesh = Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (5, 5, 5)], [(0, 1, 2)])
    for weights in ("uniform", "cotan"):
        laplacian = laplacian_of(mesh, weights)
        assert laplacian.mass[3] == 0
        assert (laplacian.apply(mesh.vertices)[3] == 0).all()
