"""Marching tetrahedra give closed, outward surfaces that converge to the shape, as other levels of fields do."""

import numpy as np
import pytest

from cascadenorm.data_gen import DatasetConfig, pair
from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.scanning import isosurfaces
from cascadenorm.data_gen.scanning.isosurfaces import isosurface, marching_tetrahedra
from cascadenorm.data_gen.shapes import fields
from cascadenorm.data_gen.shapes.fields import sphere
from cascadenorm.mesh import angles_between


def ball(count: int) -> np.ndarray:
    """Values above 0.5 inside a ball whose radius is a third of the count of nodes."""
    nodes = np.stack(np.meshgrid(*[np.arange(count) - 0.5 * (count - 1) + 0.13] * 3, indexing="ij"), axis=-1)
    return 0.5 + count / 3 - np.linalg.norm(nodes, axis=-1)


def test_a_ball_is_closed_points_outward_and_has_its_volume():
    mesh = marching_tetrahedra(ball(24))
    assert is_manifold(mesh)
    assert (mesh.topology.edge_faces.counts == 2).all()
    assert (mesh.topology.balance == 0).all()
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 8**3, rel=0.01)
    radius = np.linalg.norm(mesh.vertices - (0.5 * 23 - 0.13), axis=1)
    assert np.abs(radius - 8).max() < 0.1


def test_quadrilaterals_are_cut_in_two_coplanar_triangles():
    mesh = marching_tetrahedra(ball(24))
    across = mesh.face_normals[mesh.topology.faces_across]
    least = angles_between(across.reshape(-1, 3), np.repeat(mesh.face_normals, 3, axis=0)).reshape(-1, 3).min(axis=1)
    assert 0.3 < (least < 1e-6).mean() < 0.9


def test_the_error_falls_with_the_square_of_the_spacing():
    errors = []
    for count in (12, 24, 48):
        mesh = marching_tetrahedra(ball(count))
        radius = np.linalg.norm(mesh.vertices - (0.5 * (count - 1) - 0.13), axis=1) / count
        errors.append(np.sqrt(np.mean((radius - 1 / 3) ** 2)))
    assert np.polyfit(np.log([12, 24, 48]), np.log(errors), 1)[0] < -1.7


def test_a_volume_without_a_surface_is_unfit():
    with pytest.raises(UnfitShapeError, match="no surface"):
        marching_tetrahedra(np.zeros((4, 4, 4)))


def test_the_truth_of_a_noisy_field_is_the_shape():
    config = DatasetConfig(
        seed=2, families=("tetrahedra",), min_faces=1200, max_faces=1800, min_level=0.2, max_level=0.3
    )
    made = pair(config, 0)
    known = made.normals.any(axis=1)
    assert known.mean() > 0.9
    left = np.degrees(angles_between(made.noisy.face_normals[known], made.normals[known]).mean())
    assert 5 < left < 50


@pytest.mark.parametrize("smooth", [0.0, 1.0])
def test_relief_of_a_level_is_in_its_field(monkeypatch, smooth):
    monkeypatch.setattr(isosurfaces, "SMOOTH_SHARE", smooth)
    heights: dict[float, list[float]] = {0.0: [], 1.0: []}
    for share in heights:
        monkeypatch.setattr(isosurfaces, "RELIEF_SHARE", share)
        for seed in range(8):
            rng, ball = np.random.default_rng(seed), sphere(radius=1.0)
            mesh = isosurface(ball, extent_of(ball, rng=rng), faces=4000, rng=rng)
            assert (mesh.topology.edge_faces.counts == 2).all()
            heights[share].append(np.std(np.linalg.norm(mesh.vertices, axis=1)) / mesh.mean_edge_length)
    assert max(heights[0.0]) < 0.03  # the mesher interpolates
    assert np.median(heights[1.0]) > 0.05 and max(heights[1.0]) < 3


BALL = fields.sphere(radius=0.8)


@pytest.mark.parametrize("name", isosurfaces.MESHERS)
@pytest.mark.parametrize("seed", range(3))
def test_isosurfaces_have_no_error_but_that_of_interpolation(monkeypatch, name, seed):
    mesher, density, _ = isosurfaces.MESHERS[name]
    monkeypatch.setattr(isosurfaces, "MESHERS", {name: (mesher, density, 1.0)})
    monkeypatch.setattr(isosurfaces, "RELIEF_SHARE", 0.0)
    rng = np.random.default_rng(seed)
    extent = extent_of(BALL, rng=rng)
    mesh = isosurface(BALL, extent, faces=6000, rng=rng)
    assert is_manifold(mesh) and not mesh.topology.boundary_vertices.any()
    assert 3000 < len(mesh.faces) < 10000
    diagonal = np.sqrt(3 * density * extent.area / 6000)  # of a cell, the longest line on which values are interpolated
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 0.8).max() < diagonal**2 / (8 * 0.8)
