"""Structured meshes follow their parameters; subdivided cages have the connectivity of their subdivision."""

import numpy as np
import pytest
from shapes import icosphere

from cascadenorm.data_gen.dataset import DatasetConfig, pair
from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.structured import grid_faces, structured_mesh, subdivided_cage, terrain_mesh
from cascadenorm.mesh import Mesh


@pytest.mark.parametrize("around", [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize("seed", range(4))
def test_a_grid_has_the_euler_characteristic_of_its_surface(around, seed):
    rows, columns = 7, 9
    faces = grid_faces(rows, columns, around=around, rng=np.random.default_rng(seed))
    mesh = Mesh(np.random.default_rng(0).normal(size=(rows * columns, 3)), faces)
    cells = (rows - (not around[0])) * (columns - (not around[1]))
    assert len(faces) == 2 * cells
    assert is_manifold(mesh)
    expected = 0 if any(around) else 1  # a torus or an annulus, a disc
    assert rows * columns - len(mesh.topology.edges) + len(faces) == expected


@pytest.mark.parametrize("seed", range(6))
def test_structured_meshes_are_consistently_oriented_manifolds_of_the_wanted_size(seed):
    mesh = structured_mesh(faces=3000, rng=np.random.default_rng(seed))
    assert is_manifold(mesh)
    assert 2000 < len(mesh.faces) < 4500
    assert (mesh.topology.balance[mesh.topology.interior_edges] == 0).all()


def test_some_structured_meshes_have_triangles_ten_times_as_long_as_high_with_noise_that_fits_them():
    config = DatasetConfig(families=("structured",), noise_kinds=("normal",), min_level=0.3, max_level=0.3)
    made = [pair(config, index) for index in range(12)]
    ratios = [np.median(one.clean.longest_edges / one.clean.heights) for one in made]
    assert min(ratios) < 3 and max(ratios) > 10
    for one in made:
        moved = np.linalg.norm(one.noisy.vertices - one.clean.vertices, axis=1)
        assert np.sqrt((moved**2).mean()) < 0.5 * one.clean.heights.mean()


def test_a_terrain_has_one_height_above_each_post():
    mesh = terrain_mesh(faces=2000, rng=np.random.default_rng(0))
    assert len(np.unique(mesh.vertices[:, :2], axis=0)) == len(mesh.vertices)
    assert len(np.unique(np.sign(mesh.face_normals[:, 2]))) == 1


@pytest.mark.parametrize("seed", range(4))
def test_a_subdivided_cage_has_regular_vertices_but_for_those_of_the_cage(seed):
    mesh = subdivided_cage(icosphere(4), faces=4000, rng=np.random.default_rng(seed))
    assert 3000 < len(mesh.faces) < 5000
    valences = mesh.topology.vertex_neighbors.counts
    irregular = np.count_nonzero(valences != 6)
    assert irregular <= len(mesh.faces) / 4 / 2 + 2, "at most the vertices of a cage of a quarter of the faces"
    assert 0.5 < mesh.volume / (4 / 3 * np.pi) < 1.02, "Loop's scheme shrinks a coarse cage"
