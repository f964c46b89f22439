"""Bilateral filters of vertices equal their formulas, and keep planes and edges."""

import numpy as np
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.baselines.bilateral_vertex import bilateral, non_iterative_bilateral, vertex_normals
from cascadenorm.mesh import Mesh

ROUGH = noisy(icosphere(2), 0.15)


@settings(max_examples=10)
@given(st.integers(0, 1000))
def test_a_step_equals_its_formula(seed):
    rough = noisy(icosphere(1), 0.2, seed=seed)
    np.testing.assert_allclose(bilateral(rough, iterations=1), reference.fleishman_step(rough), rtol=0, atol=1e-12)


@settings(max_examples=10)
@given(st.floats(0.8, 2), st.floats(0.1, 3))
def test_non_iterative_filter_equals_its_formula(sigma_f, sigma_g):
    ours = non_iterative_bilateral(ROUGH, sigma_f=sigma_f, sigma_g=sigma_g)
    np.testing.assert_allclose(ours, reference.jones(ROUGH, sigma_f=sigma_f, sigma_g=sigma_g), rtol=0, atol=1e-12)


def test_planes_stay():
    sheet = grid(8, 8)
    np.testing.assert_allclose(bilateral(sheet), sheet.vertices, atol=1e-14)
    np.testing.assert_allclose(non_iterative_bilateral(sheet), sheet.vertices, atol=1e-14)


def test_vertices_move_along_their_normals_only():
    step = bilateral(ROUGH, iterations=1) - ROUGH.vertices
    np.testing.assert_allclose(np.cross(step, vertex_normals(ROUGH)), 0, atol=1e-13)


def test_spreads_given_in_mean_edges_are_used():
    """Wide spreads leave the mean height over the tangent plane; narrow heights leave everything where it is."""
    sheet = grid(6, 6)
    bump = sheet.vertices.copy()
    bump[24] += 0, 0, 0.1  # the middle one; its normal stays upright
    raised = sheet.moved(bump)
    sigma_c = 0.55 / raised.mean_edge_length  # the four next neighbours lie within 2 σ_c
    ours = bilateral(raised, sigma_c=sigma_c, sigma_s=1e6, iterations=1)[24]
    weight = np.exp(-0.5 * (1 + 0.01) / 0.55**2)
    np.testing.assert_allclose(ours, [3, 3, 0.1 - 0.1 * 4 * weight / (1 + 4 * weight)], atol=1e-9)
    kept = bilateral(raised, sigma_c=sigma_c, sigma_s=1e-3, iterations=1)
    np.testing.assert_allclose(kept, raised.vertices, atol=1e-12)


def error(clean, vertices):
    return np.linalg.norm(clean.moved(vertices).face_normals - clean.face_normals, axis=1).mean()


def test_noise_goes():
    clean = icosphere(3)
    rough = noisy(clean, 0.1, seed=2)
    for smooth in (bilateral(rough), non_iterative_bilateral(rough)):
        assert error(clean, smooth) < 0.7 * error(clean, rough.vertices)


def test_edges_stay_sharper_than_without_similarity():
    clean = cube(10)
    rough = noisy(clean, 0.05, seed=2)
    assert error(clean, bilateral(rough, sigma_s=0.1)) < 0.7 * error(clean, bilateral(rough, sigma_s=100))
    narrow, wide = (non_iterative_bilateral(rough, sigma_g=sigma_g) for sigma_g in (0.1, 100))
    assert error(clean, narrow) < 0.7 * error(clean, wide)


def test_lonely_coinciding_and_unused_vertices_stay():
    vertices = np.concatenate([ROUGH.vertices, ROUGH.vertices[:1], [[7.0, 7, 7]]])
    dirty = Mesh(vertices, np.concatenate([ROUGH.faces, [[0, 1, 162], [3, 3, 4]]]))
    for out in (bilateral(dirty), non_iterative_bilateral(dirty)):
        assert np.isfinite(out).all() and (out[-1] == 7).all()


def test_two_faces_alone_move_alike_at_every_scale():
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0.3], [1, 1.2, 0.1]], [[0, 1, 2], [2, 1, 3]])
    moved, scaled = (cn.denoise(mesh.moved(s * mesh.vertices), method="non-iterative-bilateral") for s in (1, 3.7))
    np.testing.assert_allclose(scaled.vertices / 3.7, moved.vertices, rtol=0, atol=1e-9)
