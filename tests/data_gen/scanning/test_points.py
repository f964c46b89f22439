"""Reconstruction from points: exact points give the shape back, noisy ones the bumps that scans have."""

import numpy as np
import pytest
from shapes import signed_volume

from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.scanning import points
from cascadenorm.data_gen.scanning.points import poisson, reconstruction, sampled_points
from cascadenorm.data_gen.scanning.volumes import volume_surface
from cascadenorm.data_gen.shapes import fields
from cascadenorm.mesh import angles_between

BALL = fields.sphere(radius=0.8)


def test_points_lie_on_the_shape_but_for_their_noise():
    rng = np.random.default_rng(0)
    rough = extent_of(BALL, rng=rng).rough
    exact, normals = sampled_points(BALL, rough, count=4000, level=0.0, size=0.05, rng=rng)
    gap = np.abs(np.linalg.norm(exact, axis=1) - 0.8)
    assert np.median(gap) < 1e-5  # outliers are few
    assert (gap > 1e-3).mean() < 0.011
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    noisy, _ = sampled_points(BALL, rough, count=4000, level=0.5, size=0.05, rng=rng)
    spacing = np.sqrt(rough.area / 4000)
    assert np.median(np.abs(np.linalg.norm(noisy, axis=1) - 0.8)) == pytest.approx(0.5 * 0.6745 * spacing, rel=0.1)


def test_poisson_gives_back_a_ball_from_exact_points():
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(8000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cell = 0.06
    axis = cell * (np.arange(40) - 19.5)
    nodes = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    volume = poisson(nodes, 0.8 * normals, normals, cell=cell, screening=2.0, width=1.0)
    mesh = volume_surface(volume)
    vertices = nodes[0, 0, 0] + cell * mesh.vertices
    radius = np.linalg.norm(vertices, axis=1)
    assert radius.mean() == pytest.approx(0.8, rel=2e-3)
    assert radius.std() < 0.1 * cell
    assert signed_volume(mesh) * cell**3 == pytest.approx(4 / 3 * np.pi * 0.8**3, rel=0.01)


def test_noisier_points_make_larger_bumps():
    errors = []
    for level in (0.02, 1.0):
        rng = np.random.default_rng(2)
        made = reconstruction(BALL, extent_of(BALL, rng=rng), faces=5000, level=level, rng=rng)
        errors.append(np.degrees(angles_between(made.noisy.face_normals, made.normals)).mean())
    assert errors[1] > 1.5 * errors[0]


class Counted(Exception):
    pass


def test_clouds_differ_in_density_up_to_fewer_points_than_a_tenth_of_the_vertices(monkeypatch):
    counts = []

    def counted(field, rough, *, count, **settings):
        counts.append(count)
        raise Counted  # what becomes of the points does not matter here

    monkeypatch.setattr(points, "sampled_points", counted)
    extent = extent_of(BALL, rng=np.random.default_rng(0))
    for seed in range(12):
        with pytest.raises(Counted):
            reconstruction(BALL, extent, faces=30_000, level=0.3, rng=np.random.default_rng(seed))
    assert min(counts) < 0.08 * 30_000
    assert max(counts) > 0.8 * 30_000
