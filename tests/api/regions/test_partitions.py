"""Surfaces of volumes of labels: closed regions, consistent labels, truth by the functions that define the regions."""

import numpy as np
import pytest
from partitions import FOUR_CELLS, HALF_BALLS, PARTITIONS, TILT, label_nets, members, walls


@pytest.mark.parametrize("name", PARTITIONS)
def test_each_region_is_closed_and_as_large_as_its_voxels(name):
    found = walls(name)
    for label in range(1, found.labels.max() + 1):
        region = found.region(label)
        assert (region.topology.edge_faces.counts % 2 == 0).all() and not region.topology.balance.any()
        voxels = _voxels(name, label)
        assert region.volume == pytest.approx(voxels, rel=0.04)  # the nets cut corners off


def _voxels(name: str, label: int) -> float:
    axis = np.arange(-1.4, 1.45, 0.1)
    nodes = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return 0.1**3 * (PARTITIONS[name].labels(nodes) == label).sum()


def test_one_voxel_is_an_octahedron_with_cut_corners():
    volume = np.zeros((3, 3, 3), np.int64)
    volume[1, 1, 1] = 4
    found = label_nets(volume)
    assert len(found.mesh.vertices) == 8 and len(found.mesh.faces) == 12
    np.testing.assert_allclose(np.abs(found.mesh.vertices - 1), 1 / 6 + 1 / 6 * np.ones((8, 3)), atol=0.2)
    assert found.region(4).volume > 0


def test_walls_that_reach_the_border_end_there():
    volume = np.ones((4, 4, 4), np.int64)
    volume[2:] = 2
    found = label_nets(volume)
    np.testing.assert_array_equal(found.mesh.vertices[:, 0], 1.5)
    np.testing.assert_array_equal(found.labels, np.tile([1, 2], (len(found.labels), 1)))
    np.testing.assert_allclose(found.mesh.face_normals, np.tile([1.0, 0, 0], (len(found.labels), 1)))


def test_normals_are_those_of_sphere_and_plane():
    points = np.array([[0.9, 0, 0.1], [0, 0.7, 0.1], [0.1, 0.2, 0.1]])
    normals = HALF_BALLS.normals(points, np.array([[1, 0], [0, 2], [1, 2]]))
    np.testing.assert_allclose(normals[0], points[0] / np.linalg.norm(points[0]), atol=1e-6)
    np.testing.assert_allclose(normals[1], -points[1] / np.linalg.norm(points[1]), atol=1e-6)
    np.testing.assert_allclose(normals[2], TILT, atol=1e-6)


def test_nearest_junction_point_of_four_cells_is_the_origin():
    sets = members(np.array([[1, 2, 3, 4]]), 5)
    np.testing.assert_allclose(FOUR_CELLS.nearest(np.array([[0.1, -0.1, 0.05]]), sets), np.zeros((1, 3)), atol=1e-9)


def test_nearest_junction_of_half_balls_is_on_the_circle():
    found = HALF_BALLS.nearest(np.array([[0.7, 0.1, 0.2]]), members(np.array([[0, 1, 2]]), 3))
    assert np.linalg.norm(found) == pytest.approx(0.8, abs=1e-6)
    assert (found @ TILT)[0] == pytest.approx(0, abs=1e-6)
