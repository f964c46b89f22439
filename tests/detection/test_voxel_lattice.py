"""The voxels of a volume are found from the surface that was extracted from it."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from shapes import cube, grid, icosphere, noisy
from voxels import extracted, volume

from cascadenorm.detection.voxel_lattice import lattice_of_grey_values, lattice_of_mask

BALL = icosphere(5)
TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]


@pytest.mark.parametrize("voxel", [(1.0, 1.0, 1.0), (0.7, 0.7, 2.1), (1.0, 1.3, 0.8)])
@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_the_voxels_of_a_mask_are_found_at_any_rotation(voxel, turn):
    mesh = extracted(np.where(volume("egg", voxel) > 0, 0.5, -0.5), voxel)
    mesh = mesh.moved(mesh.vertices @ turn.T + 7)
    lattice = lattice_of_mask(mesh)
    assert lattice is not None
    np.testing.assert_allclose(np.sort(np.linalg.norm(lattice, axis=1)), np.sort(voxel), rtol=1e-3)
    along = np.abs(lattice @ turn) / np.linalg.norm(lattice, axis=1)[:, None]
    np.testing.assert_allclose(np.sort(along, axis=1), [[0, 0, 1]] * 3, atol=2e-3)


def test_vertices_in_ambiguous_cells_do_not_hide_the_voxels():
    values = gaussian_filter(np.random.default_rng(0).normal(size=(24, 24, 24)), 0.9)
    mesh = extracted(np.where(np.pad(values, 2, constant_values=-1) > 0.05, 0.5, -0.5), (1.0, 1.0, 3.0))
    places = np.unique(np.round(2 * mesh.vertices / [1, 1, 3]).astype(int) % 2, axis=0)
    assert len(places) == 4  # the middles of edges along each axis, and of cells
    np.testing.assert_allclose(np.linalg.norm(lattice_of_mask(mesh), axis=1), (1, 1, 3), rtol=1e-3)


@pytest.mark.parametrize("voxel", [(1.0, 1.0, 1.0), (0.7, 0.7, 1.6)])
def test_the_voxels_of_grey_values_are_found_along_the_axes(voxel):
    mesh = extracted(volume("egg", voxel), voxel)
    np.testing.assert_allclose(lattice_of_grey_values(mesh), np.diag(voxel), rtol=1e-2)
    assert lattice_of_mask(mesh) is None


@pytest.mark.parametrize("mesh", [BALL, noisy(BALL, 0.2), grid(30, 30), cube(8)])
def test_other_meshes_have_no_voxels(mesh):
    mesh = mesh.moved(mesh.vertices @ TURN.T)
    assert lattice_of_mask(mesh) is None
    assert lattice_of_grey_values(mesh) is None
