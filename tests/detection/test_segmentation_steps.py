"""Steps of a segmentation are recognised in any pose, whatever meshed them; CAD parts on a lattice are not."""

from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes import ball_of_voxels, cubes, cylinder, grid, icosphere, noisy, side_by_side
from voxels import volume

import cascadenorm as cn
from cascadenorm.api.inspection import inspect
from cascadenorm.data_gen.meshing.cad_tessellation import PartBuilder
from cascadenorm.data_gen.scanning.volumes import surface_nets, volume_surface
from cascadenorm.detection.error_kind import error_kind
from cascadenorm.detection.segmentation_steps import has_voxel_faces, is_segmentation
from cascadenorm.detection.voxel_lattice import lattice_share
from cascadenorm.mesh import angles_between


@pytest.mark.parametrize("seed", range(3))
def test_marching_cubes_of_a_mask_are_a_segmentation_in_any_pose(seed):
    mesh = volume_surface(ball_of_voxels(11.0).astype(float))
    mesh = mesh.moved(mesh.vertices @ Rotation.random(random_state=seed).as_matrix().T)
    assert lattice_share(mesh) > 0.99
    assert is_segmentation(mesh)
    assert not has_voxel_faces(mesh)


@pytest.mark.parametrize("stretch", [1.0, 2.5])
def test_a_segmentation_is_recognised_whatever_meshed_it(stretch):
    mesh = surface_nets(ball_of_voxels(11.0, stretch=stretch).astype(float))
    assert is_segmentation(mesh.moved(mesh.vertices * (1, 1, stretch)))
    assert is_segmentation(cubes(ball_of_voxels(11.0, stretch=stretch)))


@pytest.mark.parametrize("mesh", [cylinder(60), icosphere(4), noisy(icosphere(4), 0.2), grid(20, 20)])
def test_other_surfaces_are_no_segmentation(mesh):
    assert not is_segmentation(mesh)


@pytest.mark.parametrize("stretch", [1.0, 2.5])
def test_faces_of_voxels_are_told_and_denoised(stretch):
    mesh = cubes(ball_of_voxels(11.0, stretch=stretch))
    middle = np.full(3, 14.7 + 0.5)  # of a mesh that is padded by a voxel and lies between their centres
    turn = Rotation.random(random_state=1).as_matrix()
    mesh = mesh.moved((mesh.vertices - middle) * (1, 1, stretch) @ turn.T)
    assert has_voxel_faces(mesh)
    denoised = cn.denoise(mesh.vertices, mesh.faces)
    assert error_kind(mesh, denoised).kind == "segmentation"
    true = mesh.centroids / np.linalg.norm(mesh.centroids, axis=1)[:, None]
    before, after = (np.degrees(angles_between(m.face_normals, true).mean()) for m in (mesh, mesh.moved(denoised)))
    assert before > 30 and after < 0.3 * before


def test_voxel_faces_beside_another_surface_are_denoised_as_on_their_own():
    voxels, ball = cubes(ball_of_voxels(11.0)), noisy(icosphere(4), 0.2)
    ball = ball.moved(20 * ball.vertices)
    both = side_by_side(voxels, ball)
    denoised = np.split(cn.denoise(both.vertices, both.faces), [len(voxels.vertices)])
    denoised[1] -= 100.0
    for mesh, vertices in zip((voxels, ball), denoised, strict=True):
        assert vertices == pytest.approx(cn.denoise(mesh.vertices, mesh.faces), abs=1e-5)


def test_a_bracket_on_a_grid_does_not_have_voxel_faces_though_it_lies_on_a_lattice():
    bracket = np.ones((12, 12, 12), bool)
    bracket[4:, 4:] = False
    assert lattice_share(cubes(bracket)) == 1
    assert not has_voxel_faces(cubes(bracket))
    assert not has_voxel_faces(grid(30, 30))
    assert not has_voxel_faces(icosphere(3))


def test_a_plate_with_many_equal_holes_is_no_segmentation_though_its_edges_repeat():
    part = PartBuilder(delaunay=True, rng=np.random.default_rng(0))
    angle = 2 * np.pi * np.arange(6) / 6
    hole = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline = np.array([[-3, -3], [41, -3], [41, 41], [-3, 41]], float)
    loops = [outline, *(hole + np.array([4.0 * i, 4.0 * j]) for i in range(10) for j in range(10))]
    lower, upper = ([part.ring(np.insert(loop, 2, z, axis=1)) for loop in loops] for z in (0.0, 1.0))
    for number, (below, above) in enumerate(zip(lower, upper, strict=True)):
        part.wall([below, above] if number == 0 else [above, below])
    part.face(upper[0], upper[1:])
    part.face(lower[0], lower[1:], up=False)
    plate = part.mesh()
    assert lattice_share(plate) > 0.9
    assert not is_segmentation(plate)


@pytest.mark.parametrize("extract", [surface_nets, partial(surface_nets, centered=True)])
def test_a_segmentation_with_an_edge_of_length_zero_is_told_by_its_steps(extract):
    """Snapping, decimation and exports with few digits collapse edges; the faces there have no normal and no bend."""
    mesh = extract(np.where(volume("egg", (1.0, 1.0, 1.0)) > 0, 1.0, 0.0))
    vertices, (a, b) = mesh.vertices.copy(), mesh.faces[len(mesh.faces) // 2, :2]
    vertices[a] = vertices[b]
    collapsed = mesh.moved(vertices)
    assert np.count_nonzero(collapsed.areas == 0) == 2
    assert is_segmentation(mesh) and is_segmentation(collapsed)
    assert inspect(collapsed).error.kind == "segmentation"
    assert np.isfinite(cn.denoise(vertices, mesh.faces)).all()
