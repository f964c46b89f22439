"""Scans out of a volume: on the surface without error, on lattice edges with it, slivers in one piece with the rest."""

import contextlib
from functools import cache

import numpy as np
import pytest

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.scanning.measured import Measured
from cascadenorm.data_gen.scanning.views import fused, largest_sheets, scanned_view
from cascadenorm.data_gen.shapes import fields
from cascadenorm.mesh import unit

BALL = fields.sphere(radius=1)


@cache
def scan_of(field, *, level: float, seed: int) -> Measured:
    """Draw again where triangles fold, as data sets do."""
    for attempt in range(20):
        rng = np.random.default_rng([seed, attempt])
        with contextlib.suppress(UnfitShapeError):
            return fused(field, extent_of(field, rng=rng), faces=4000, level=level, rng=rng)
    raise UnfitShapeError


def test_the_clean_mesh_is_the_surface_beneath_the_noisy_one():
    sizes, seen = [], []
    for seed in range(10):
        noisy, clean, _ = scan_of(BALL, level=0.2, seed=seed)
        assert is_manifold(noisy)
        np.testing.assert_array_equal(noisy.faces, clean.faces)
        np.testing.assert_allclose(np.linalg.norm(clean.vertices, axis=1), 1, atol=1e-6)
        np.testing.assert_allclose(np.cross(noisy.vertices, clean.vertices), 0, atol=1e-5)
        assert np.median((noisy.face_normals * noisy.centroids).sum(axis=1)) > 0.9  # outward
        sizes.append(len(clean.faces))
        seen.append(clean.area / (4 * np.pi))
    assert 0.6 * 4000 < np.median(sizes) < 1.6 * 4000
    assert min(seen) < 0.5 and max(seen) > 0.8  # from one side, and from all around


def test_more_error_of_the_cameras_is_more_error_of_the_scan():
    far = [
        np.mean([np.abs(np.linalg.norm(scan_of(BALL, level=level, seed=seed).noisy.vertices, axis=1) - 1).mean()
                 for seed in range(4)])
        for level in (0.0, 0.1, 0.4)
    ]  # fmt: skip
    assert far[0] < 0.8 * far[1] < 0.7 * far[2]


def test_vertices_of_a_sliver_err_alike():
    """Unlike noise drawn for each vertex, that of a volume hardly differs along its short edges."""
    jumps = []
    for seed in range(10):
        noisy, clean, _ = scan_of(BALL, level=0.2, seed=seed)
        error = np.linalg.norm(noisy.vertices, axis=1) - 1
        ends = clean.topology.edges
        lengths = np.linalg.norm(clean.vertices[ends[:, 0]] - clean.vertices[ends[:, 1]], axis=1)
        jump = np.abs(error[ends[:, 0]] - error[ends[:, 1]])
        jumps.append([jump[lengths < 0.2 * lengths.mean()].mean(), jump[lengths > lengths.mean()].mean()])
    short, long = np.mean(jumps, axis=0)
    assert 0 < short < 0.5 * long


def test_detail_that_drowns_is_unfit():
    """A scan whose clean mesh would be wrong is none to learn from."""
    hair = fields.intersection(BALL, lambda points: np.abs(np.sin(60 * points[:, 0])) / 60 - 0.004)
    reasons = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        with pytest.raises(UnfitShapeError) as unfit:
            fused(hair, extent_of(hair, rng=rng), faces=4000, level=0.9, rng=rng)
        reasons.append(str(unfit.value))
    assert sum("not that of the shape" in reason for reason in reasons) >= 6


def test_a_sheet_without_any_face_is_unfit():
    with pytest.raises(UnfitShapeError, match="next to nothing"):
        largest_sheets(np.zeros((3, 3)), np.zeros((0, 3), np.int32))


def test_a_view_is_what_is_seen_from_one_side():
    ball = fields.sphere(radius=1)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        mesh = scanned_view(ball, extent_of(ball, rng=rng), faces=4000, rng=rng)
        assert 0.6 * 4000 < len(mesh.faces) < 1.6 * 4000 and is_manifold(mesh)
        np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, atol=2e-3)
        toward = unit(mesh.area_vectors.sum(axis=0)[None])[0]
        assert (mesh.vertices @ toward).min() > -0.05
        assert (mesh.face_normals * mesh.centroids).sum(axis=1).min() > 0.9
