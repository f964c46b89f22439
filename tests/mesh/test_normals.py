"""Stored normals are made anew where vertices have moved, and only there."""

import numpy as np
import pytest
from mesh_files import ply_of
from sample_files import OBJ, read, stl_binary, written
from shapes import cube, icosphere

import cascadenorm as cn
from cascadenorm.api.inspection import inspect
from cascadenorm.mesh import unit


def test_stl_normals_follow_and_attributes_stay():
    file = read(stl_binary())
    data = written(file.with_vertices(file.mesh.vertices * (1, 2, 3)))
    again = read(data)
    records = np.frombuffer(data, [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")], offset=84)
    assert np.allclose(records["n"], again.mesh.face_normals, atol=1e-7)
    assert records["a"].tolist() == [1, 2, 3, 65535]
    assert data[:80] == stl_binary()[:80]


def test_obj_normals_follow_the_faces_that_use_them():
    file = read(OBJ)
    turn = np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)])  # z becomes y
    text = written(file.with_vertices(file.mesh.vertices @ turn.T)).decode()
    assert "vn 0.0 -1.0 0.0" in text.replace("-0.0", "0.0").replace("0.0 1.0 0.0", "0.0 -1.0 0.0")
    assert "vt 0.5 1\n" in text
    assert "v 1.0  0" in text


@pytest.mark.parametrize("sign", [1, -1])
def test_vertex_normals_of_the_sphere_stay_radial(sign):
    sphere = icosphere(3)
    file = ply_of(sphere.vertices, sphere.faces.astype(np.int64), sign * sphere.vertices)
    stretched = sphere.vertices * (1, 1, 2)
    again = read(written(file.with_vertices(stretched))).content().vertex_values
    found = np.stack([again[n] for n in ("nx", "ny", "nz")], axis=1)
    assert np.allclose(np.linalg.norm(found, axis=1), 1)
    assert (np.einsum("ij,ij->i", found, sign * unit(stretched / (1, 1, 4))) > 0.99).all()


def test_equal_normals_at_a_seam_stay_equal_and_creases_stay():
    soup = cube(2).corners.reshape(-1, 3)
    faces = np.arange(len(soup)).reshape(-1, 3)
    flat = np.repeat(cube(2).face_normals, 3, axis=0)
    bent = ply_of(soup, faces, flat)
    moved = bent.with_vertices(bent.mesh.vertices * (1, 1, 2))
    again = moved.content().vertex_values
    found = np.stack([again[n] for n in ("nx", "ny", "nz")], axis=1)
    assert np.allclose(found, flat)
    smooth = ply_of(soup, faces, unit(soup))
    noise = np.random.default_rng(0).normal(size=smooth.mesh.vertices.shape) / 20
    moved = smooth.with_vertices(smooth.mesh.vertices + noise)
    again = moved.content().vertex_values
    found = np.stack([again[n] for n in ("nx", "ny", "nz")], axis=1)
    assert len(np.unique(np.column_stack([moved.welds, found]), axis=0)) == len(smooth.mesh.vertices)


def test_normals_that_are_not_a_number_at_a_seam_are_renewed_each_from_its_own_faces():
    soup = cube(2).corners.reshape(-1, 3)
    file = ply_of(soup, np.arange(len(soup)).reshape(-1, 3), np.full(soup.shape, np.nan))
    again = file.with_vertices(file.mesh.vertices * (1, 1, 2)).content().vertex_values
    found = np.stack([again[n] for n in ("nx", "ny", "nz")], axis=1)
    assert np.allclose(found, np.repeat(cube(2).face_normals, 3, axis=0))


@pytest.mark.parametrize("scale", [1e300, 1.0, 1e-250])
def test_normals_of_any_size_are_right(scale):
    sphere = icosphere(2)
    file = ply_of(sphere.vertices * scale, sphere.faces.astype(np.int64), sphere.vertices[:, [1, 2, 0]])
    again = file.with_vertices(sphere.vertices * scale / 2).content().vertex_values
    found = np.stack([again[n] for n in ("nx", "ny", "nz")], axis=1)
    assert (np.abs(np.einsum("ij,ij->i", found, sphere.vertices)) > 0.99).all()


@pytest.mark.filterwarnings("error")
def test_vertices_that_are_signalling_nans_are_isolated_in_silence(tmp_path):
    data = bytearray(stl_binary())
    data[84 + 12 : 84 + 16] = b"\x01\x00\xa0\x7f"
    (tmp_path / "a.stl").write_bytes(data)
    done = cn.denoise_file(tmp_path / "a.stl", method="laplacian", on_bad="isolate")
    assert (done.isolated_vertices, done.isolated_faces) == (1, 1)
    assert inspect(tmp_path / "a.stl").not_finite.count == 1


def test_normals_that_are_signalling_nans_are_renewed():
    sphere = icosphere(1)
    signalling = np.full(sphere.vertices.shape, 0x7F800001, np.uint32).view(np.float32)
    file = ply_of(sphere.vertices, sphere.faces.astype(np.int64), signalling)
    again = file.with_vertices(sphere.vertices * 2).content().vertex_values
    assert np.allclose([again[n] for n in ("nx", "ny", "nz")], sphere.vertices.T, atol=0.1)


def test_normals_far_from_what_moved_stay():
    sphere = icosphere(2)
    tilted = unit(sphere.vertices + np.array((0.3, 0, 0)))
    file = ply_of(sphere.vertices, sphere.faces.astype(np.int64), tilted)
    vertices = sphere.vertices.copy()
    vertices[0] *= 1.1
    again = file.with_vertices(vertices).content().vertex_values
    changed = np.any([again[n] != tilted[:, i] for i, n in enumerate(("nx", "ny", "nz"))], axis=0)
    ring = np.unique(sphere.faces[(sphere.faces == 0).any(axis=1)])
    assert np.flatnonzero(changed).tolist() == ring.tolist()
