"""Filters of manifold harmonics keep, drop or raise the energy of the bands that they should."""

import numpy as np
import pytest
from shapes import icosphere, noisy, side_by_side

from cascadenorm.baselines.spectral import filtered, spectral
from cascadenorm.errors import ParameterError
from cascadenorm.geometry.spectra.harmonics import manifold_harmonics
from cascadenorm.mesh import Mesh

MESH = noisy(icosphere(2), 0.2)
BASIS = manifold_harmonics(MESH, 162)


def energies(vertices):
    return (BASIS.coefficients(vertices) ** 2).sum(axis=1)


def test_all_pass_is_the_identity_and_so_is_a_low_pass_with_all():
    some = manifold_harmonics(MESH, 40)
    np.testing.assert_allclose(filtered(MESH, some, np.ones(40)), MESH.vertices, atol=1e-12)
    np.testing.assert_allclose(spectral(MESH, harmonics=162), MESH.vertices, atol=1e-11)
    np.testing.assert_allclose(spectral(MESH), MESH.vertices, atol=1e-11)  # 300 by default, here all 162


@pytest.mark.parametrize("eigenpairs", ["exact", "approximate"])
def test_more_parts_than_harmonics_are_refused_before_each_shrinks_to_a_point(eigenpairs):
    ball = icosphere(1)
    parts = 12
    faces = np.concatenate([ball.faces + k * len(ball.vertices) for k in range(parts)])
    many = Mesh(np.concatenate([ball.vertices + 3 * k for k in range(parts)]), faces)
    with pytest.raises(ParameterError, match="12 connected components"):
        spectral(many, harmonics=12, eigenpairs=eigenpairs)
    spread = np.ptp(spectral(many, harmonics=60, eigenpairs="exact").reshape(parts, -1, 3), axis=1)
    assert (spread > 1).all()


def test_low_pass_keeps_what_is_low_and_drops_the_rest():
    before, after = energies(MESH.vertices), energies(spectral(MESH, harmonics=50))
    np.testing.assert_allclose(after[:50], before[:50], rtol=1e-9)
    assert after[50:].max() < 1e-20
    after = energies(spectral(MESH, harmonics=50, band_end=20))
    assert after[20:].max() < 1e-20


def test_exaggeration_raises_the_energy_of_the_band_by_the_square_of_the_gain():
    moved = spectral(MESH, harmonics=60, transfer="exaggerate", band_start=10, band_end=30, gain=1.7)
    expected = energies(MESH.vertices)
    expected[10:30] *= 1.7**2
    np.testing.assert_allclose(energies(moved), expected, rtol=1e-9)


def test_enhancement_raises_all_above_the_start_of_the_band():
    moved = spectral(MESH, harmonics=60, transfer="enhance", band_start=10, gain=1.3)
    expected = energies(MESH.vertices)
    expected[10:] *= 1.3**2
    np.testing.assert_allclose(energies(moved), expected, rtol=1e-9)


@pytest.mark.parametrize("transfer", ["enhance", "exaggerate"])
def test_components_keep_their_centroids(transfer):
    mesh = side_by_side(*(noisy(icosphere(2), 0.2, seed=seed) for seed in range(3)))
    masses = manifold_harmonics(mesh, 1).mass[:, None]
    moved = spectral(mesh, harmonics=40, transfer=transfer, gain=3)
    for mass, before, after in zip(*(np.split(each, 3) for each in (masses, mesh.vertices, moved)), strict=True):
        np.testing.assert_allclose((mass * after).sum(axis=0), (mass * before).sum(axis=0), rtol=1e-9)


def test_weights_may_be_any_function_of_the_eigenvalues():
    moved = filtered(MESH, BASIS, 1 / (1 + 0.1 * BASIS.values))
    expected = BASIS.vectors @ (BASIS.coefficients(MESH.vertices) / (1 + 0.1 * BASIS.values[:, None]))
    np.testing.assert_allclose(moved, expected, atol=1e-12)


def test_approximate_harmonics_filter_much_like_exact_ones():
    rough = noisy(icosphere(5), 0.1)
    exact = spectral(rough, harmonics=49, eigenpairs="exact")
    fast = spectral(rough, harmonics=49, eigenpairs="approximate")
    assert 0 < np.linalg.norm(exact - fast, axis=1).mean() < 0.05 * rough.mean_edge_length
    assert np.linalg.norm(rough.vertices - exact, axis=1).mean() > 0.05 * rough.mean_edge_length


def test_lone_vertices_stay():
    lone = Mesh(np.concatenate([MESH.vertices, [[5, 6, 7]]]), MESH.faces)
    assert (spectral(lone, harmonics=9)[-1] == (5, 6, 7)).all()


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"harmonics": 163}, "this mesh has 162"),
        ({"harmonics": 20, "band_start": 20, "transfer": "enhance"}, "the band from 20 to 20"),
        ({"harmonics": 20, "band_end": 21}, "within the 20 harmonics"),
    ],
)
def test_bad_parameters_are_refused(settings, words):
    with pytest.raises(ParameterError, match=words):
        spectral(MESH, **settings)
