"""Descriptors are the filtered normals of the paper, with the own normal first where their names say so."""

import numpy as np
from shapes import cube, icosphere, noisy
from stages import stage_settings

from cascadenorm.geometry.neighborhoods import faces_near
from cascadenorm.learned.descriptors import CUTOFF, SIGMA_R, SIGMA_S, bilateral_descriptor, guided_descriptor
from cascadenorm.learned.features import FLOOR, all_pairs, pairwise_features
from cascadenorm.learned.packed_normals import unpacked
from cascadenorm.learned.regression import stage_stack
from cascadenorm.mesh import Mesh, unit

MESH = noisy(icosphere(2), 0.2)


def reference_descriptor(mesh: Mesh) -> np.ndarray:
    """The descriptors as the paper writes them: B-FND, then G-FND, face by face, with Gaussians that are cut off."""
    n, c, a, l = mesh.face_normals, mesh.centroids, mesh.areas, mesh.mean_edge_length

    def gauss(x, sigma):
        return np.exp(-(x**2) / (2 * sigma**2))

    def filtered(sigma_s, sigma_r, guide):
        rows = []
        for f in range(len(n)):
            distance = np.linalg.norm(c - c[f], axis=1)
            g = np.flatnonzero(distance <= CUTOFF * sigma_s * l)
            w = a[g] * gauss(distance[g], sigma_s * l)
            w *= gauss(np.linalg.norm(guide[g] - guide[f], axis=1), sigma_r)
            rows.append(w @ n[g])
        return unit(np.array(rows))

    plain = [filtered(s, r, n) for s in SIGMA_S for r in SIGMA_R]
    guided = [filtered(s, r, filtered(s, np.inf, n)) for s in SIGMA_S for r in SIGMA_R[:-1]]
    return np.stack([*plain, *guided], axis=1)


def test_descriptors_equal_their_formula():
    guided = guided_descriptor(MESH)
    np.testing.assert_allclose(guided, reference_descriptor(MESH), atol=3e-6)
    plain = bilateral_descriptor(MESH)
    np.testing.assert_array_equal(plain, guided[:, : len(SIGMA_S) * len(SIGMA_R)])


def test_the_faces_of_a_filter_hold_the_gaussian():
    """On an even triangulation, where Σ A exp(-d²/2σ²) of all faces is 2πσ²."""
    ball = icosphere(4)
    sigma_s, every = 2 * ball.mean_edge_length, np.arange(len(ball.faces), dtype=np.int32)
    near = faces_near(ball, every, CUTOFF * sigma_s)
    distance = np.linalg.norm(ball.centroids[near.indices] - ball.centroids[near.rows], axis=1)
    weights = np.bincount(near.rows, ball.areas[near.indices] * np.exp(-0.5 * (distance / sigma_s) ** 2))
    assert weights.mean() / (2 * np.pi * sigma_s**2) > 0.94


def test_the_own_normal_stands_before_the_filtered_ones():
    before = MESH.moved(1.1 * MESH.vertices + 0.1 * icosphere(2).vertices)
    plain = unpacked(stage_stack(stage_settings("B"), before, MESH))
    np.testing.assert_allclose(plain, bilateral_descriptor(before), atol=3e-7)
    both = unpacked(stage_stack(stage_settings("n+B"), before, MESH))
    np.testing.assert_array_equal(both[:, 1:], plain)
    np.testing.assert_allclose(both[:, 0], before.face_normals, atol=3e-7)


def test_descriptors_of_a_plane_are_its_normal_and_their_angles_vanish():
    side = cube(14)
    every = np.arange(len(side.faces), dtype=np.int32)
    near = faces_near(side, every, CUTOFF * max(SIGMA_S) * side.mean_edge_length)
    inside = [f for f in every if np.ptp(side.face_normals[near.row(f)], axis=0).max() == 0]
    assert len(inside) > 10
    stack = guided_descriptor(side)[inside]
    np.testing.assert_allclose(stack, np.broadcast_to(side.face_normals[inside][:, None], stack.shape), atol=1e-6)
    np.testing.assert_allclose(pairwise_features(stack, all_pairs(18)), np.log(FLOOR), atol=2e-2)
