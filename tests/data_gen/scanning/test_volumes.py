"""Surfaces out of volumes: steps as high as a voxel, the truth beneath them, and an enclosed volume that stays."""

import numpy as np
import pytest
from measured_fields import measured
from shapes import signed_volume

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.scanning import volumes
from cascadenorm.data_gen.scanning.volumes import segmentation, surface_nets, tomogram, volume_surface
from cascadenorm.data_gen.shapes import fields
from cascadenorm.detection.segmentation_steps import has_voxel_faces
from cascadenorm.mesh import angles_between

BALL = fields.sphere(radius=0.8)
BOX = fields.box([0.5, 0.6, 0.7])


def mask(radius: float, count: int = 24):
    nodes = np.stack(np.meshgrid(*[np.arange(count) - count / 2 + 0.3] * 3, indexing="ij"), axis=-1)
    return (np.linalg.norm(nodes, axis=-1) < radius).astype(np.float64)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("settings", [{"slices": False}, {"slices": True}])
def test_the_truth_of_a_segmented_ball_is_radial(settings, seed):
    made = measured(segmentation, BALL, seed=seed, **settings)
    np.testing.assert_allclose(np.linalg.norm(made.clean.vertices, axis=1), 0.8, atol=1e-6)
    known = made.normals.any(axis=1)
    assert known.mean() > 0.99
    radial = made.noisy.centroids[known] / np.linalg.norm(made.noisy.centroids[known], axis=1, keepdims=True)
    np.testing.assert_allclose(made.normals[known], radial, atol=2e-3)


def test_the_steps_of_segmentations_are_those_of_voxels():
    deviations, largest = [], []
    for seed in range(9):
        noisy = measured(segmentation, BALL, seed=seed, slices=False).noisy
        gap = np.linalg.norm(noisy.vertices, axis=1) - 0.8
        voxel = noisy.mean_edge_length / 0.9  # edges of marching cubes on a mask are ½√2 voxels long, and one
        deviations.append(gap.std() / voxel)
        largest.append(np.abs(gap).max() / voxel)
    assert 0.1 < np.median(deviations) < 0.4  # some are smoothed, some ragged
    assert np.median(largest) < 1


def test_thick_slices_make_higher_steps_along_their_axis(monkeypatch):
    monkeypatch.setattr(volumes, "ENLARGED", 0.0)
    thick = [measured(segmentation, BALL, seed=seed, slices=True) for seed in range(64)]
    cubes = [measured(segmentation, BALL, seed=seed, slices=False) for seed in range(64)]

    def step(made):
        return np.abs(np.linalg.norm(made.noisy.vertices, axis=1) - 0.8).mean() / made.noisy.mean_edge_length

    assert np.mean([step(made) for made in thick]) > 1.2 * np.mean([step(made) for made in cubes])


def test_enlarged_labels_make_steps_twice_as_high(monkeypatch):
    heights = []
    for share in (0.0, 1.0):
        monkeypatch.setattr(volumes, "ENLARGED", share)
        balls = [measured(segmentation, BALL, seed=seed, slices=False).noisy for seed in range(8)]
        heights.append(
            np.mean([np.std(np.linalg.norm(ball.vertices, axis=1)) / ball.mean_edge_length for ball in balls])
        )
    assert 1.5 < heights[1] / heights[0] < 2.5


def test_a_tomogram_errs_with_its_grain():
    errors = []
    for level in (0.02, 0.9):
        made = measured(tomogram, BOX, seed=3, level=level)
        known = made.normals.any(axis=1)
        errors.append(np.degrees(angles_between(made.noisy.face_normals[known], made.normals[known])).mean())
    assert errors[1] > errors[0] + 3


@pytest.mark.parametrize("mesher", [volume_surface, surface_nets])
def test_meshes_of_a_mask_are_closed_outward_and_hold_its_voxels(mesher):
    volume = mask(8.0)
    mesh = mesher(volume)
    assert not mesh.topology.boundary_vertices.any()
    assert (mesh.topology.edge_faces.counts == 2).all()
    assert signed_volume(mesh) == pytest.approx(volume.sum(), rel=0.05)


def test_centred_surface_nets_are_the_faces_of_the_voxels():
    volume = mask(8.0)
    mesh = surface_nets(volume, centered=True)
    assert has_voxel_faces(mesh)
    assert signed_volume(mesh) == pytest.approx(volume.sum(), rel=1e-12)


def test_surface_nets_are_exact_on_a_plane_of_grey_values():
    """Crossings of a linear field lie on its plane, and so do their means."""
    nodes = np.stack(np.meshgrid(*[np.arange(12.0)] * 3, indexing="ij"), axis=-1)
    normal = np.array([0.3, -0.5, 0.8])
    ball = 4 - np.linalg.norm(nodes - 5.5, axis=-1)  # closes the surface, away from the plane
    volume = 0.5 + np.minimum(-(nodes - 5.5) @ normal, ball)
    mesh = surface_nets(volume)
    level = (mesh.vertices - 5.5) @ normal
    inner = np.linalg.norm(mesh.vertices - 5.5, axis=1) < 2.5
    assert inner.sum() > 10
    np.testing.assert_allclose(level[inner], 0, atol=1e-12)
    assert (mesh.face_normals[np.isin(mesh.faces, np.flatnonzero(inner)).all(axis=1)] @ normal > 0).all()


def test_volumes_without_a_surface_are_refused():
    for mesher in (volume_surface, surface_nets):
        with pytest.raises(UnfitShapeError):
            mesher(np.zeros((5, 5, 5)))
