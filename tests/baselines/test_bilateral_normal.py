"""Bilateral filters of face normals, one pass at a time or as one system, equal their formulas."""

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import cube, grid, icosphere, noisy

from cascadenorm.baselines.bilateral_normal import (
    bilateral_difference,
    bilateral_normals,
    global_normals,
    joint_bilateral_pass,
    spatial_weights,
)
from cascadenorm.mesh import Mesh, unit

ROUGH = noisy(icosphere(2), 0.2)


@pytest.mark.compiled
@settings(max_examples=20)
@given(st.floats(0.05, 2), st.floats(0.2, 3), st.sampled_from([1, 2]), st.sampled_from(["skip", "count"]))
def test_a_pass_equals_its_formula(sigma_r, sigma_s, ring, center):
    ours = bilateral_normals(ROUGH, sigma_s=sigma_s, sigma_r=sigma_r, iterations=1, ring=ring, center=center)
    rings = ROUGH.topology.face_rings(ring)
    expected = reference.joint_bilateral_pass(
        ROUGH, ROUGH.face_normals, rings, sigma_s=sigma_s, sigma_r=sigma_r, count_self=center == "count"
    )
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-12)


def test_range_weight_is_taken_on_the_guide():
    guide = unit(np.random.default_rng(1).normal(size=ROUGH.face_normals.shape))
    rings = ROUGH.topology.face_rings(1)
    ours = joint_bilateral_pass(ROUGH.face_normals, guide, ROUGH.areas, rings, spatial_weights(ROUGH, rings, 1.0), 0.4)
    expected = reference.joint_bilateral_pass(ROUGH, guide, rings, sigma_s=1.0, sigma_r=0.4, count_self=True)
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-12)


def test_without_range_weight_it_is_the_gaussian_mean():
    ours = bilateral_normals(ROUGH, sigma_s=1e6, sigma_r=np.inf, iterations=1, center="count")
    rings = ROUGH.topology.face_rings(1)
    means = [ROUGH.area_vectors[np.append(rings.row(f), f)].sum(axis=0) for f in range(len(ROUGH.faces))]
    np.testing.assert_allclose(ours, unit(np.array(means)), atol=1e-9)


def test_narrow_range_keeps_what_differs():
    clean = cube(4)
    np.testing.assert_allclose(
        bilateral_normals(clean, sigma_s=1, sigma_r=0.1, iterations=20), clean.face_normals, atol=1e-12
    )
    wide = bilateral_normals(clean, sigma_s=1, sigma_r=2.0, iterations=20)
    assert np.linalg.norm(wide - clean.face_normals, axis=1).mean() > 0.1


def test_no_iterations_keep_the_normals_and_lonely_faces_their_own():
    np.testing.assert_array_equal(bilateral_normals(ROUGH, sigma_s=1, sigma_r=0.3, iterations=0), ROUGH.face_normals)
    triangles = Mesh(np.random.default_rng(0).normal(size=(6, 3)), [(0, 1, 2), (3, 4, 5)])
    alone = bilateral_normals(triangles, sigma_s=1, sigma_r=0.3, iterations=3)
    np.testing.assert_array_equal(alone, triangles.face_normals)


def test_faces_without_area_weigh_nothing():
    flat = Mesh(np.concatenate([ROUGH.vertices, ROUGH.vertices[:1]]), np.concatenate([ROUGH.faces, [[0, 1, 162]]]))
    normals = bilateral_normals(flat, sigma_s=0.7, sigma_r=0.4, iterations=1)
    weights = spatial_weights(flat, flat.topology.face_rings(1), 0.7)
    assert (weights[flat.topology.face_rings(1).indices == 320] == 0).all()
    assert np.isfinite(normals).all() and np.linalg.norm(normals[-1]) == pytest.approx(1)


SPREADS = {"sigma_s": 0.8, "sigma_r": 0.4}


def test_difference_equals_its_formula_and_annihilates_constants():
    difference = bilateral_difference(ROUGH, **SPREADS)
    expected = reference.bilateral_difference(ROUGH, ROUGH.topology.face_rings(1), **SPREADS)
    np.testing.assert_allclose(difference.toarray(), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(difference @ np.ones(len(ROUGH.faces)), 0, atol=1e-12)


def test_solution_equals_that_of_the_dense_system():
    difference = reference.bilateral_difference(ROUGH, ROUGH.topology.face_rings(1), **SPREADS)
    areas = np.diag(ROUGH.areas)
    for fidelity in (0.01, 0.3):
        matrix = (1 - fidelity) * difference.T @ areas @ difference + fidelity * areas
        expected = unit(np.linalg.solve(matrix, fidelity * areas @ ROUGH.face_normals))
        np.testing.assert_allclose(global_normals(ROUGH, **SPREADS, fidelity=fidelity), expected, atol=1e-8)


def test_full_fidelity_is_the_identity():
    np.testing.assert_allclose(global_normals(ROUGH, **SPREADS, fidelity=1), ROUGH.face_normals, atol=1e-10)


def test_faces_without_area_or_neighbours_do_no_harm():
    sheet = grid(3, 3)
    vertices = np.concatenate([sheet.vertices, [[9.0, 9, 9], [10, 9, 9], [9, 10, 9]]])
    dirty = Mesh(vertices, np.concatenate([sheet.faces, [[0, 0, 1], [16, 17, 18]]]))
    normals = global_normals(dirty, **SPREADS, fidelity=0.01)
    np.testing.assert_allclose(normals[dirty.areas > 0], dirty.face_normals[dirty.areas > 0], atol=1e-12)
    assert np.isfinite(normals).all()
