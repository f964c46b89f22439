"""Meshes check their arrays, are immutable, and have the lengths and areas of their formulas at any size."""

import copy
import pickle

import numpy as np
import pytest
from shapes import cube, icosphere, noisy

import cascadenorm as cn
from cascadenorm.mesh import Mesh, MeshError, isolated

BALL = noisy(icosphere(2), 0.1)


@pytest.mark.parametrize("exponent", [1000, 996, -500, -1000])
def test_lengths_scale_to_the_bit_with_the_mesh(exponent):
    scaled = BALL.moved(np.ldexp(BALL.vertices, exponent))
    assert scaled.mean_edge_length == np.ldexp(BALL.mean_edge_length, exponent)
    assert scaled.diagonal == np.ldexp(BALL.diagonal, exponent)


def test_lengths_of_denormal_coordinates():
    tiny = BALL.moved(BALL.vertices * 1e-310)
    assert tiny.mean_edge_length == pytest.approx(BALL.mean_edge_length * 1e-310, rel=1e-6, abs=0)
    assert tiny.diagonal == pytest.approx(BALL.diagonal * 1e-310, rel=1e-6, abs=0)


def test_lengths_beyond_the_largest_number_are_infinite():
    far = Mesh(np.array([[-1.5e308, 0, 0], [1.5e308, 0, 0], [0, 1.5e308, 0]]), [[0, 1, 2]])
    assert far.diagonal == np.inf
    assert far.mean_edge_length == np.inf
    assert Mesh(far.vertices / 3, [[0, 1, 2]]).mean_edge_length == pytest.approx(1e308 / 3 * (1 + np.sqrt(2)))


@pytest.mark.parametrize("make", [Mesh, isolated, lambda *arrays: cn.denoise(arrays)])
def test_lists_with_rows_of_different_lengths_are_refused(make):
    triangle = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    with pytest.raises(MeshError, match=r"vertices are a list whose rows have different lengths; .*\(n, 3\) numbers"):
        make([*triangle, [1, 1]], [[0, 1, 2]])
    with pytest.raises(MeshError, match=r"faces are a list whose rows have different lengths; .*\(m, 3\) integers"):
        make(triangle, [[0, 1, 2], [0, 1, 2, 0]])


@pytest.mark.parametrize("make", [Mesh, isolated, lambda *arrays: cn.denoise(arrays)])
def test_masked_arrays_are_refused_if_a_value_is_masked(make):
    vertices, faces = np.ma.array(np.eye(3)), np.ma.array([[0, 1, 2]])
    make(vertices, faces)
    with pytest.raises(MeshError, match="faces have masked indices: leave these faces out"):
        make(vertices, np.ma.masked_equal(faces, 2))
    with pytest.raises(MeshError, match="vertices have masked coordinates: replace them by NaN"):
        make(np.ma.masked_equal(vertices, 1), faces)


@pytest.mark.parametrize("vertices", ["x", [[0, 0, 0], [1]]])
def test_a_mesh_is_moved_only_to_numbers(vertices):
    with pytest.raises(MeshError, match=r"must be \(n, 3\) numbers"):
        BALL.moved(vertices)


def test_a_stray_vertex_does_not_spoil_the_edges():
    stray = Mesh(np.concatenate([BALL.vertices, [[1e300, 0, 0]]]), BALL.faces)
    assert stray.mean_edge_length == BALL.mean_edge_length


def test_vertex_area_vectors_are_three_times_the_gradient_of_the_volume():
    mesh = noisy(icosphere(3), 0.1)
    towards = 1e-5 * np.random.default_rng(3).normal(size=mesh.vertices.shape)
    change = mesh.moved(mesh.vertices + towards).volume - mesh.moved(mesh.vertices - towards).volume
    assert (mesh.vertex_area_vectors * towards).sum() / 3 == pytest.approx(change / 2, rel=1e-7)


def test_size_is_that_of_the_faces():
    box = cube(2)
    stray = Mesh(np.vstack([box.vertices, [(1e30, 0, 0)]]), box.faces)
    assert stray.volume == pytest.approx(box.volume, rel=1e-12)
    assert stray.diagonal == box.diagonal
    np.testing.assert_array_equal(stray.box, box.box)
    np.testing.assert_array_equal(box.box, [box.vertices.min(axis=0), box.vertices.max(axis=0)])


def test_moved_takes_as_many_vertices_as_there_are():
    with pytest.raises(MeshError, match=r"\(3, 3\); it must stay \(162, 3\)"):
        icosphere(2).moved(np.zeros((3, 3)))


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda mesh: pickle.loads(pickle.dumps(mesh))])
def test_a_copy_is_as_immutable_and_brings_only_what_it_is_made_of(copied):
    mesh = icosphere(2)
    lean = len(pickle.dumps(mesh))
    assert mesh.mean_edge_length and len(pickle.dumps(mesh)) == lean
    other = copied(mesh)
    np.testing.assert_array_equal(other.vertices, mesh.vertices)
    np.testing.assert_array_equal(other.faces, mesh.faces)
    assert not other.vertices.flags.writeable and not other.faces.flags.writeable


def test_forgetting_the_geometry_keeps_numbers_and_topology():
    mesh = noisy(icosphere(1), 0.1).with_facts(mean_edge_length=7.0)
    normals, edges = mesh.face_normals, mesh.topology.edges
    mesh.forget_geometry()
    assert "face_normals" not in vars(mesh) and "area_vectors" not in vars(mesh)
    assert mesh.mean_edge_length == 7.0 and mesh.topology.edges is edges
    np.testing.assert_array_equal(mesh.face_normals, normals)
