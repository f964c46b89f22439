"""Guided filtering of normals takes its guidance from the least inconsistent patch around a face."""

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import cube, grid, icosphere, noisy

from cascadenorm.baselines.guided_normal import (
    faces_within,
    gaussian_guidance,
    guided_normal,
    patch_guidance,
    patch_statistics,
)
from cascadenorm.baselines.vertex_update import recover_vertices

ROUGH = noisy(icosphere(2), 0.2)


@settings(max_examples=5)
@given(st.integers(0, 1000))
def test_patch_statistics_equal_their_formula(seed):
    mesh = noisy(icosphere(1), 0.3, seed=seed)
    rings = mesh.topology.face_rings(1)
    for ours, expected in zip(patch_statistics(mesh, rings), reference.patch_statistics(mesh, rings), strict=True):
        np.testing.assert_allclose(ours, expected, rtol=1e-11, atol=1e-12)


def test_a_flat_patch_is_perfectly_consistent_and_one_crease_of_k_edges_counts_chord_over_k():
    sheet = grid(6, 6)
    rings = sheet.topology.face_rings(1)
    assert (patch_statistics(sheet, rings)[0] == 0).all()
    x, y, _ = sheet.vertices.T
    bent = sheet.moved(np.stack([np.minimum(x, 3), y, np.maximum(x - 3, 0)], axis=1))  # by a right angle at x = 3
    inconsistency, _ = patch_statistics(bent, rings)
    f = 2 * 6 + 2  # the face of row 2 right before the crease, with an edge on it
    left = bent.centroids[np.append(rings.row(f), f), 0] < 3
    assert not left.all()
    # the patch is what touches the vertices (2, 2), (3, 2), (3, 3): along the crease from y = 1 to y = 4
    assert inconsistency[f] == pytest.approx(np.sqrt(2) / 3, rel=1e-6)


def test_patch_guidance_does_not_look_over_an_edge():
    clean = cube(6)
    own = np.linalg.norm(patch_guidance(clean) - clean.face_normals, axis=1) < 1e-12
    cuts_a_corner = (np.abs(clean.corners) == 1).sum(axis=2).min(axis=1) > 1  # no flat patch is near these
    assert cuts_a_corner.sum() < 20
    np.testing.assert_array_equal(own, ~cuts_a_corner)
    across = gaussian_guidance(clean, faces_within(clean, 1.15), 0.6)
    assert np.abs(across - clean.face_normals).max() > 0.1


def test_guidance_comes_from_the_least_inconsistent_patch_around():
    rings = ROUGH.topology.face_rings(1)
    inconsistency, means = reference.patch_statistics(ROUGH, rings)
    near = [np.append(rings.row(f), f) for f in range(len(ROUGH.faces))]
    expected = [means[around[np.argmin(inconsistency[around])]] for around in near]
    np.testing.assert_allclose(patch_guidance(ROUGH), expected, atol=1e-12)


def test_neighbours_are_the_faces_within_the_radius():
    sphere = icosphere(2)
    near = faces_within(sphere, 1.4)
    distances = np.linalg.norm(sphere.centroids[:, None] - sphere.centroids, axis=2) / sphere.mean_edge_length
    for f in range(len(sphere.faces)):
        assert sorted(near.row(f)) == sorted(set(np.flatnonzero(distances[f] <= 1.4)) - {f})


@pytest.mark.parametrize("guidance", ["patch", "gaussian"])
def test_one_iteration_is_one_joint_pass_and_a_vertex_update(guidance):
    near = faces_within(ROUGH, 1.5)
    mean = reference.joint_bilateral_pass(ROUGH, ROUGH.face_normals, near, sigma_s=0.8, sigma_r=np.inf, count_self=True)
    guide = patch_guidance(ROUGH) if guidance == "patch" else mean
    normals = reference.joint_bilateral_pass(ROUGH, guide, near, sigma_s=0.8, sigma_r=0.3, count_self=True)
    ours = guided_normal(ROUGH, guidance=guidance, radius=1.5, sigma_s=0.8, sigma_r=0.3, iterations=1, sweeps=7)
    np.testing.assert_allclose(ours, recover_vertices(ROUGH, normals, sweeps=7), atol=1e-12)
