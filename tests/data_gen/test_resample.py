"""Resampled surfaces have other triangles but the same shape, and the truth of resampled scans is the scanned shape."""

import numpy as np
import pytest
from shapes import icosphere

from cascadenorm.data_gen import DatasetConfig, pair
from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.resample import resampled
from cascadenorm.mesh import angles_between


def ripples(scale):
    mesh = icosphere(5)
    return mesh.moved(mesh.vertices * (1 + scale * np.sin(9 * mesh.vertices[:, :1])))


@pytest.mark.parametrize("seed", range(4))  # both ways of resampling
def test_a_resampled_surface_has_about_so_many_faces_near_the_surface(seed):
    mesh = ripples(0.05)
    made = resampled(mesh, faces=5000, rng=np.random.default_rng(seed))
    assert is_manifold(made)
    assert 3500 < len(made.faces) < 6500
    radius = np.linalg.norm(made.vertices, axis=1)
    surface = 1 + 0.05 * np.sin(9 * made.vertices[:, 0] / radius)
    assert np.abs(radius - surface).max() < 0.01
    assert made.volume == pytest.approx(mesh.volume, rel=0.01)


def test_the_truth_of_a_resampled_scan_is_the_shape():
    config = DatasetConfig(
        seed=5, families=("resampled_scan",), min_faces=1200, max_faces=1800, min_level=0.2, max_level=0.3
    )
    for index in range(4):
        made = pair(config, index)
        known = made.normals.any(axis=1)
        assert known.mean() > 0.9
        error = np.degrees(angles_between(made.noisy.face_normals[known], made.normals[known]).mean())
        truth = np.degrees(angles_between(made.clean.face_normals[known], made.normals[known]).mean())
        assert 2 < error < 50
        assert truth < error
