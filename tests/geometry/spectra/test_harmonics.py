"""Harmonics solve the eigenproblem of the Laplacian, each of them once."""

from functools import partial

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation
from shapes import grid, icosphere, noisy

from cascadenorm.errors import ParameterError
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.geometry.spectra import harmonics
from cascadenorm.geometry.spectra.fast_harmonics import fast_harmonics
from cascadenorm.geometry.spectra.harmonics import manifold_harmonics, shape_dna
from cascadenorm.mesh import Mesh, one_blas_thread

SPHERE = icosphere(4)  # 2,562 vertices: found in bands


def rectangle(rows, columns, width, height):
    plane = grid(rows, columns)
    return plane.moved(plane.vertices * (width / columns, height / rows, 1))


def test_spectrum_of_the_sphere():
    values = manifold_harmonics(SPHERE, 17).values
    assert values[0] == pytest.approx(0, abs=1e-9)
    assert values[1:4] == pytest.approx(2, rel=0.01)
    assert values[4:9] == pytest.approx(6, rel=0.01)
    assert values[9:16] == pytest.approx(12, rel=0.01)
    assert values[16] > 19


@pytest.mark.parametrize("boundary, first", [("free", 0), ("fixed", 1)])
def test_spectrum_of_a_rectangle(boundary, first):
    modes = np.array([(i, j) for i in range(first, 9) for j in range(first, 9)])
    expected = np.sort(np.pi**2 * ((modes[:, 0] / 2) ** 2 + modes[:, 1] ** 2))[:12]
    found = manifold_harmonics(rectangle(40, 80, 2.0, 1.0), 12, boundary=boundary)
    np.testing.assert_allclose(found.values, expected, rtol=0.015, atol=1e-9)
    if boundary == "fixed":
        assert (found.vectors[grid(40, 80).topology.boundary_vertices] == 0).all()


def test_pairs_solve_the_eigenproblem_and_are_orthonormal():
    mesh = noisy(SPHERE, 0.2)
    found = manifold_harmonics(mesh, 150)
    laplacian = cotangent_laplacian(mesh)
    residual = laplacian.stiffness @ found.vectors - laplacian.mass[:, None] * found.vectors * found.values
    assert abs(residual).max() < 1e-9
    np.testing.assert_allclose(found.coefficients(found.vectors), np.eye(150), atol=1e-9)
    assert (np.diff(found.values) >= -1e-9).all()


def test_bands_find_each_eigenvalue_once_the_repeated_ones_of_a_regular_sphere_too(monkeypatch):
    sphere = icosphere(3)
    laplacian = cotangent_laplacian(sphere)
    with one_blas_thread():
        expected = eigh(laplacian.stiffness.toarray(), np.diag(laplacian.mass), eigvals_only=True)[:200]
    monkeypatch.setattr(harmonics, "DENSE", 0)
    found = manifold_harmonics(sphere, 200)
    np.testing.assert_allclose(found.values, expected, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(found.coefficients(found.vectors), np.eye(200), atol=1e-8)


def test_all_eigenpairs_of_a_small_mesh():
    mesh = noisy(icosphere(1), 0.2)
    found = manifold_harmonics(mesh, 42)
    laplacian = cotangent_laplacian(mesh)
    rebuilt = (laplacian.mass[:, None] * found.vectors * found.values) @ (found.vectors.T * laplacian.mass)
    np.testing.assert_allclose(rebuilt, laplacian.stiffness.toarray(), atol=1e-10)


def test_dense_and_banded_agree_up_to_nothing_but_rounding(monkeypatch):
    mesh = noisy(icosphere(3), 0.2)
    dense = manifold_harmonics(mesh, 100)
    monkeypatch.setattr(harmonics, "DENSE", 0)
    banded = manifold_harmonics(mesh, 100)
    np.testing.assert_allclose(banded.values, dense.values, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(banded.vectors, dense.vectors, atol=1e-5)


@pytest.mark.parametrize("factor", [2.0**-330, 2.0**330])
@pytest.mark.parametrize("harmonics_of", [manifold_harmonics, partial(fast_harmonics, samples=30)])
def test_harmonics_of_tiny_and_huge_meshes_are_those_of_the_mesh_scaled(harmonics_of, factor):
    mesh = noisy(icosphere(2), 0.2)
    found, expected = harmonics_of(mesh.moved(factor * mesh.vertices), 9), harmonics_of(mesh, 9)
    np.testing.assert_allclose(found.values * factor**2, expected.values, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.vectors * factor, expected.vectors, atol=1e-9)
    np.testing.assert_allclose(found.mass / factor**2, expected.mass, rtol=1e-9)


def test_shape_dna_by_area_has_no_limit_of_scale():
    mesh = noisy(icosphere(2), 0.2)
    by_area = shape_dna(mesh.moved(1e-200 * mesh.vertices), 9, scale="area")
    np.testing.assert_allclose(by_area, shape_dna(mesh, 9, scale="area"), rtol=1e-9, atol=1e-9)


def test_shape_dna_knows_the_shape_but_neither_pose_nor_order_nor_size():
    mesh = noisy(icosphere(2), 0.2)
    expected = shape_dna(mesh, 20)
    rng = np.random.default_rng(0)
    order = rng.permutation(len(mesh.vertices))
    place = np.argsort(order)
    turned = Rotation.random(random_state=0).apply(mesh.vertices.copy())[order] + 3
    other = Mesh(turned, place[mesh.faces][rng.permutation(len(mesh.faces))])
    np.testing.assert_allclose(shape_dna(other, 20), expected, rtol=1e-9, atol=1e-9)
    larger = mesh.moved(3 * mesh.vertices)
    np.testing.assert_allclose(shape_dna(larger, 20), expected / 9, rtol=1e-9, atol=1e-9)
    by_area = shape_dna(larger, 20, scale="area")
    np.testing.assert_allclose(by_area, expected * mesh.area, rtol=1e-9, atol=1e-9)
    stretched = mesh.moved(mesh.vertices * (1, 1, 1.3))
    assert abs(shape_dna(stretched, 20, scale="area") / by_area - 1)[1:].max() > 0.05


@pytest.mark.parametrize("count", [0, 43])
def test_more_harmonics_than_vertices_are_refused(count):
    with pytest.raises(ParameterError, match="this mesh has 42: ask for 1 to 42"):
        manifold_harmonics(icosphere(1), count)


def test_lone_vertices_take_no_part():
    mesh = noisy(icosphere(1), 0.2)
    lone = Mesh(np.concatenate([[[9, 9, 9]], mesh.vertices]), mesh.faces + 1)
    found = manifold_harmonics(lone, 42)
    np.testing.assert_allclose(found.values, manifold_harmonics(mesh, 42).values, atol=1e-9)
    assert (found.vectors[0] == 0).all()


def test_many_equal_parts_have_each_eigenvalue_as_often_as_there_are_parts():
    part = noisy(icosphere(1), 0.2)
    places = np.arange(40)[:, None, None]
    many = Mesh(
        (part.vertices + 4 * places * (1, 0, 0)).reshape(-1, 3),
        (part.faces + len(part.vertices) * places).reshape(-1, 3),
    )
    found = manifold_harmonics(many, 120)
    expected = np.repeat(manifold_harmonics(part, 3).values, 40)
    np.testing.assert_allclose(found.values, expected, atol=1e-8)
    np.testing.assert_allclose(found.coefficients(found.vectors), np.eye(120), atol=1e-9)


def test_what_cannot_be_told_apart_is_refused(monkeypatch):
    monkeypatch.setattr(harmonics, "RESTARTS", 1)
    monkeypatch.setattr(harmonics, "DENSE", 0)
    with pytest.raises(ParameterError, match="request fewer"):
        manifold_harmonics(icosphere(3), 100)


@pytest.mark.parametrize("lowest", [manifold_harmonics, partial(fast_harmonics, samples=200), shape_dna])
def test_repeated_faces_and_faces_that_repeat_a_vertex_do_not_count(lowest):
    ball = noisy(icosphere(3), 0.1)
    doubled = Mesh(ball.vertices, [*ball.faces, *ball.faces[:90, ::-1], (0, 1, 0)])
    found, expected = (np.atleast_2d(getattr(one, "values", one)) for one in (lowest(doubled, 9), lowest(ball, 9)))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
