"""What `auto` guarantees holds for any displacement that a model may come up with."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import coil, cube, cylinder, grid, icosphere, mean_angle, noisy, torus

import cascadenorm as cn
from cascadenorm.geometry.foldovers import foldovers, without_flips
from cascadenorm.learned.safeguards import safeguarded
from cascadenorm.mesh import Mesh


def flipped(before: Mesh, vertices: np.ndarray) -> np.ndarray:
    """Faces whose normal is 90° or more from what it was; a face without area has none."""
    turn = np.einsum("ij,ij->i", before.moved(vertices).area_vectors, before.area_vectors)
    return (turn <= 0) & (before.areas > 0)


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


@pytest.mark.parametrize("mesh", [cube(1), cube(6), cylinder(10), cylinder(90)])
@given(seed=st.integers(0, 10**6))
def test_meshes_whose_chords_show_no_noise_stay_but_for_rounding(mesh, seed):
    wanted = mesh.vertices + np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    np.testing.assert_allclose(safeguarded(mesh, wanted), mesh.vertices, rtol=0, atol=1e-13)


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


@pytest.mark.parametrize("mesh", [cube(1), cylinder(24), cylinder(300, 20.0)], ids=["cube", "strips", "long strips"])
def test_auto_leaves_cad_alone_but_for_the_rounding_of_single_precision(mesh):
    vertices = mesh.vertices.astype(np.float32)
    rounding = 30 * float(np.spacing(np.abs(vertices).max()))
    np.testing.assert_allclose(cn.denoise(vertices, mesh.faces), vertices, rtol=0, atol=rounding)


@pytest.mark.parametrize("mesh", [torus(60, 24), coil(2.5, 80)], ids=["torus", "coil"])
def test_auto_hardly_changes_a_tessellated_surface_without_error(mesh):
    denoised = mesh.moved(cn.denoise(mesh.vertices, mesh.faces))
    assert mean_angle(denoised, mesh) < 0.15
    assert np.linalg.norm(denoised.vertices - mesh.vertices, axis=1).max() < 2e-4 * mesh.diagonal
