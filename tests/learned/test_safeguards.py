"""The bounds on where a model may move vertices hold for any displacement."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import coil, cube, cylinder, flipped, grid, icosphere, mean_angle, noisy, torus

import cascadenorm as cn
from cascadenorm.detection.chords import chord_noise, chord_residuals
from cascadenorm.geometry.foldovers import foldovers
from cascadenorm.learned.safeguards import FACE_HEIGHTS, NOISE_FACTOR, displacement_bounds, safeguarded
from cascadenorm.mesh import Mesh

ROUGH = {
    "noisy ball": noisy(icosphere(3), 0.1),
    "noisy sheet": noisy(grid(12, 12), 0.2),
    "noisy strips": noisy(cylinder(90), 0.01),
    "waves": torus(60, 24, waves=0.15),
}


def wanted(mesh: Mesh, seed: int, size: float) -> np.ndarray:
    return mesh.vertices + size * mesh.diagonal * np.random.default_rng(seed).normal(size=mesh.vertices.shape)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), size=st.floats(1e-6, 1))
def test_a_box_keeps_its_bits_whatever_is_asked_for(seed, size):
    mesh = cube(4)
    assert safeguarded(mesh, wanted(mesh, seed, size)).tobytes() == mesh.vertices.tobytes()


@pytest.mark.parametrize("name", ROUGH)
@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), size=st.floats(1e-6, 1))
def test_no_vertex_passes_its_bound_and_no_face_flips(name, seed, size):
    mesh = ROUGH[name]
    moved = safeguarded(mesh, wanted(mesh, seed, size))
    length = np.linalg.norm(moved - mesh.vertices, axis=1)
    assert (length <= displacement_bounds(mesh) * (1 + 1e-9)).all()
    assert not (flipped(mesh, moved) & ~foldovers(mesh)).any()


@pytest.mark.parametrize("name", ROUGH)
def test_the_bound_is_what_the_docs_say(name):
    mesh = ROUGH[name]
    noise = chord_noise(mesh, chord_residuals(mesh))
    tallest = [mesh.heights[mesh.topology.vertex_faces.row(i)].max() for i in range(len(mesh.vertices))]
    np.testing.assert_allclose(
        displacement_bounds(mesh), np.minimum(NOISE_FACTOR * noise, FACE_HEIGHTS * np.array(tallest))
    )


def test_what_is_within_the_bounds_is_not_touched():
    mesh = noisy(icosphere(4), 0.1)
    clean = icosphere(4).vertices
    assert safeguarded(mesh, clean).tobytes() == clean.tobytes()


def test_the_bound_follows_the_noise_over_the_mesh():
    """Half of a sheet is rough: there vertices may move, on the other half hardly."""
    sheet = grid(40, 40)
    heights = 0.2 * np.random.default_rng(0).normal(size=len(sheet.vertices)) * (sheet.vertices[:, 0] < 20)
    bounds = displacement_bounds(sheet.moved(sheet.vertices + heights[:, None] * [0, 0, 1]))
    assert bounds[sheet.vertices[:, 0] < 18].min() > 1
    assert bounds[sheet.vertices[:, 0] > 30].max() < 1e-9


@pytest.mark.parametrize("mesh", [cube(1), cube(6), cylinder(10), cylinder(90)])
@given(seed=st.integers(0, 10**6))
def test_meshes_whose_chords_show_no_noise_stay_but_for_rounding(mesh, seed):
    wanted = mesh.vertices + np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    np.testing.assert_allclose(safeguarded(mesh, wanted), mesh.vertices, rtol=0, atol=1e-13)


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
