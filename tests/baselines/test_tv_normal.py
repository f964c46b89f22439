"""Total variation of normals is minimised as its formula says."""

import numpy as np
import pytest
from shapes import grid, icosphere, noisy

from cascadenorm.baselines import tv_normal
from cascadenorm.baselines.tv_normal import TotalVariation, difference_operator

ROUGH = noisy(icosphere(1), 0.2)


def parts(mesh):
    """D, w, l, A, n* as in the formula, in mean edge lengths."""
    pairs = mesh.topology.face_pairs
    difference = difference_operator(pairs, len(mesh.faces))
    shared = [np.intersect1d(mesh.faces[f], mesh.faces[g]) for f, g in pairs]
    lengths = np.array([np.linalg.norm(mesh.vertices[i] - mesh.vertices[j]) for i, j in shared])
    weights = np.exp(-(np.linalg.norm(difference @ mesh.face_normals, axis=1) ** 4))
    edge = mesh.mean_edge_length
    return difference, weights, lengths / edge, mesh.areas / edge**2, mesh.face_normals


def least_variation(mesh, *, fidelity, rounds):
    return TotalVariation(mesh, fidelity=fidelity).least(mesh.face_normals, rounds=rounds)


def energy(mesh, values, fidelity):
    difference, weights, lengths, areas, given = parts(mesh)
    variation = (weights * lengths) @ np.linalg.norm(difference @ values, axis=1)
    return variation + fidelity * areas @ ((values - given) ** 2).sum(axis=1)


@pytest.mark.parametrize("fidelity", [0.1, 1.0])
def test_solution_is_optimal(fidelity):
    values, duals = least_variation(ROUGH, fidelity=fidelity, rounds=1500)
    difference, weights, lengths, areas, given = parts(ROUGH)
    assert (np.linalg.norm(duals, axis=1) <= weights * (1 + 1e-9)).all()
    gradient = 2 * fidelity * areas[:, None] * (values - given) + difference.T @ (lengths[:, None] * duals)
    np.testing.assert_allclose(gradient, 0, atol=1e-6)
    gap = (weights * np.linalg.norm(difference @ values, axis=1) - (duals * (difference @ values)).sum(axis=1)).max()
    assert gap < 1e-6  # with the above: no other values have less energy
    nudges = np.random.default_rng(0).normal(size=(20, *values.shape))
    assert all(energy(ROUGH, values + 1e-3 * nudge, fidelity) > energy(ROUGH, values, fidelity) for nudge in nudges)


def test_twenty_rounds_come_close():
    best = energy(ROUGH, least_variation(ROUGH, fidelity=9, rounds=500).values, 9)
    assert energy(ROUGH, least_variation(ROUGH, fidelity=9, rounds=20).values, 9) < 1.01 * best


@pytest.mark.parametrize("fidelity", [1.0, 9.0])
def test_rounds_by_conjugate_gradients_minimise_as_well_as_exact_ones(fidelity, monkeypatch):
    iterative = least_variation(ROUGH, fidelity=fidelity, rounds=20).values
    monkeypatch.setattr(tv_normal, "MILD", 0.0)
    exact = least_variation(ROUGH, fidelity=fidelity, rounds=20).values
    assert (iterative != exact).any()  # two ways indeed
    assert energy(ROUGH, iterative, fidelity) < energy(ROUGH, exact, fidelity) * (1 + 1e-6)
    np.testing.assert_allclose(iterative, exact, atol=1e-4)


def test_high_fidelity_is_the_identity():
    values = least_variation(ROUGH, fidelity=1e8, rounds=50).values
    np.testing.assert_allclose(values, ROUGH.face_normals, atol=1e-6)


def test_a_step_sinks_by_length_times_weight_over_fidelity_times_area():
    """Two flat halves of area A with a jump of w l: each comes nearer to the other by w l / (2 α A)."""
    sheet = grid(6, 6)
    x, y, _ = sheet.vertices.T
    bent = sheet.moved(np.stack([np.minimum(x, 3), y, 0.5 * np.maximum(x - 3, 0)], axis=1) * 1.0)
    values = least_variation(bent, fidelity=2.0, rounds=1500).values
    edge = bent.mean_edge_length
    left = bent.centroids[:, 0] < 3 - 1e-9
    jump = bent.face_normals[left][0] - bent.face_normals[~left][0]
    weight, seam = np.exp(-(np.linalg.norm(jump) ** 4)), 6 / edge
    for side, sign in ((left, -1), (~left, 1)):
        moved = values[side] - bent.face_normals[side]
        expected = sign * weight * seam / (2 * 2.0 * bent.areas[side].sum() / edge**2) * jump / np.linalg.norm(jump)
        np.testing.assert_allclose(moved.mean(axis=0), expected, atol=1e-6)
