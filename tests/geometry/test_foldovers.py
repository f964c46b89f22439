"""Displacements flip no face but foldovers, and fold no edge of a smooth surface."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import flipped, grid, icosphere, noisy

from cascadenorm.geometry.foldovers import foldovers, without_flips
from cascadenorm.mesh import Mesh

SHAPES = {
    "ball": icosphere(2),
    "noisy ball": noisy(icosphere(2), 0.3),
    "sheet": noisy(grid(8, 8), 0.1),
    "slivers": grid(30, 4).moved(grid(30, 4).vertices * [1, 0.01, 1] + [0, 0, 0.3]),
}


@pytest.mark.parametrize("name", SHAPES)
@given(seed=st.integers(0, 10**6), size=st.floats(0.01, 10))
def test_no_face_flips_but_foldovers_whatever_is_asked_for(name, seed, size):
    mesh = SHAPES[name]
    wanted = mesh.vertices + size * np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    assert not (flipped(mesh, without_flips(mesh, wanted)) & ~foldovers(mesh)).any()


def angles(mesh: Mesh) -> np.ndarray:
    """Cosines of the angles between the normals of adjacent faces."""
    one, other = mesh.face_normals[mesh.topology.face_pairs].swapaxes(0, 1)
    return (one * other).sum(axis=1)


@pytest.mark.parametrize("name", SHAPES)
@given(seed=st.integers(0, 10**6), size=st.floats(0.01, 10))
def test_no_edge_folds_whatever_is_asked_for(name, seed, size):
    mesh = SHAPES[name]
    wanted = mesh.vertices + size * np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    found = mesh.moved(without_flips(mesh, wanted, smooth=np.ones(len(mesh.faces), bool)))
    limit = np.cos(np.radians(105))
    assert angles(found)[angles(mesh) >= limit].min() > limit - 1e-9
    assert not (flipped(mesh, found.vertices) & ~foldovers(mesh)).any()
    none = without_flips(mesh, wanted, smooth=np.zeros(len(mesh.faces), bool))
    assert np.array_equal(none, without_flips(mesh, wanted))


def test_a_ridge_that_flips_no_face_is_made_lower():
    """Its sides are 143° apart and, at a quarter of its height, 74°; those of a lower ridge are 84° apart and stay.

    Inner vertices move to the mean of themselves and six neighbours, and those on the boundary back to the input.
    """
    for mesh, inner, share in ((grid(6, 6), 24, 3 / 7), (grid(1, 2), 2, 1 / 4)):
        middle, smooth = mesh.vertices[:, 1].max() / 2, np.ones(len(mesh.faces), bool)
        ridge = (mesh.vertices[:, 1] == middle)[:, None] * np.array((0, 0, 1.0))
        high, low = mesh.vertices + 3 * ridge, mesh.vertices + 0.9 * ridge
        assert np.array_equal(without_flips(mesh, high), high)
        lowered = without_flips(mesh, high, smooth=smooth)
        assert lowered[inner] == pytest.approx(mesh.vertices[inner] + 3 * share * ridge[inner])
        assert angles(mesh.moved(lowered)).min() > np.cos(np.radians(105))
        assert np.array_equal(without_flips(mesh, low, smooth=smooth), low)


def test_what_does_no_harm_is_not_touched():
    mesh = noisy(icosphere(4), 0.1)
    clean = icosphere(4).vertices
    assert without_flips(mesh, clean).tobytes() == clean.tobytes()


def test_a_foldover_may_be_undone():
    mesh = grid(6, 6)
    middle = 3 * 7 + 3
    folded = mesh.vertices.copy()
    folded[middle, :2] += 1.4 * (mesh.vertices[middle + 8, :2] - mesh.vertices[middle, :2])
    bent = Mesh(folded + 0.01 * np.random.default_rng(0).normal(size=folded.shape), mesh.faces)
    assert foldovers(bent).any()
    assert without_flips(bent, mesh.vertices)[middle] == pytest.approx(mesh.vertices[middle])


def test_a_sliver_at_an_edge_does_not_flip_against_its_neighbours():
    """Around the edge of a thin plate normals differ so much that any face there might be a foldover."""
    corners = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1, 1e-3, 0], [0, 0, -1], [2, 0, -1]], float)
    plate = Mesh(corners, np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 5, 6], [0, 6, 1]]))
    everything, wanted = np.ones(6, bool), corners.copy()
    wanted[4, 1] = -1e-3
    stays = without_flips(plate, wanted, may_flip=everything)
    assert not flipped(plate, stays).any()
    assert stays[4, 1] == pytest.approx(1e-3 * (1 - 2 * 0.25))
    assert np.array_equal(without_flips(plate.moved(wanted), corners, may_flip=everything), corners)
