"""What holds for every format: nothing but positions and normals changes, and any vertices can be stored."""

import re

import numpy as np
import pytest
from gltfs import quantized
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from sample_files import COFF, NATIVE, OBJ, PLY_TEXT, every_sample, read, written

import cascadenorm as cn
from cascadenorm.io.content import Content
from cascadenorm.io.files import FORMATS
from cascadenorm.mesh import MeshError
from cascadenorm.mesh.polygons import Polygons


@every_sample
def test_unmoved_file_comes_out_as_it_went_in(data):
    file = read(data)
    assert written(file) == data
    assert written(file.with_vertices(file.mesh.vertices)) == data
    there = file.with_vertices(file.mesh.vertices + 1)
    assert written(there.with_vertices(file.mesh.vertices)) == data


@every_sample
def test_moved_file_reads_back_as_moved(data):
    file = read(data)
    wanted = file.mesh.vertices * 1.7 + np.random.default_rng(0).normal(size=file.mesh.vertices.shape)
    moved = file.with_vertices(wanted)
    again = read(written(moved))
    assert np.array_equal(again.positions, moved.positions)
    assert np.array_equal(again.positions, wanted[file.welds].astype(file.positions.dtype))
    assert np.array_equal(again.polygons.corners, file.polygons.corners)
    assert np.array_equal(moved.mesh.faces, file.mesh.faces)


@every_sample
def test_writing_moved_positions_twice_changes_nothing(data):
    once = read(data)
    once = read(written(once.with_vertices(once.mesh.vertices + 0.3)))
    assert written(once.with_vertices(once.mesh.vertices)) == written(once)


@every_sample
def test_vertices_stay_float32_or_become_float64(data):
    file = read(data)
    assert file.positions.dtype in (np.float32, np.float64)
    assert file.mesh.vertices.dtype == np.float64


@every_sample
def test_wrong_shape_and_infinite_vertices_are_refused(data):
    file = read(data)
    with pytest.raises(MeshError, match="shape"):
        file.with_vertices(file.mesh.vertices[1:])
    with pytest.raises(MeshError, match="not finite"):
        file.with_vertices(np.full(file.mesh.vertices.shape, np.inf))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("far", "vertices have shape ()"),
        ([[1], [2, 3]], "vertices are a list whose rows have different lengths"),
        (np.full((4, 3), "1"), "vertices have type <U1; they must be numbers"),
        (np.ones((4, 3), complex), "vertices have type complex128; they must be numbers"),
        (np.ma.masked_equal(np.eye(4, 3), 1.0), "vertices have masked coordinates; all of them must be numbers"),
    ],
)
def test_only_numbers_can_be_vertices_of_a_file(given, words, tetrahedron):
    with pytest.raises(MeshError, match=re.escape(words)):
        tetrahedron.with_vertices(given)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            PLY_TEXT.replace(b"3 0 1 4 8", b"3 0 1 5 8"),
            r"1 face .*\(faces 1; the first references vertex 5; there are 5",
        ),
        (OBJ.replace(b"f 2 3 5", b"f 2 3 6"), r"1 face .*\(faces 3; the first references vertex 6; .* counted from 1"),
        (OBJ.replace(b"f 2 3 5", b"f 0 3 5"), r"1 face .*\(faces 3; the first references vertex 0"),
        (OBJ.replace(b"f 2 3 5", b"f -9 3 5"), r"1 face .*\(faces 3"),
        (COFF.replace(b"3 0 2 3", b"3 0 -2 3"), r"1 face .*\(faces 1; the first references vertex -2"),
        (OBJ.replace(b"v 0 1 0", b"v 0 nan 0"), r"1 of 5 vertices are not finite \(vertices 4, counted from 1"),
        (PLY_TEXT.replace(b"1 1 1e-3", b"1 inf 0"), r"1 of 5 vertices are not finite \(vertices 2, counted from 0"),
        (PLY_TEXT.replace(b"face 3", b"face 0"), "5 vertices and no faces"),
    ],
)
def test_invalid_mesh_is_explained_in_the_numbers_of_the_file(content, words):
    file = read(content)
    with pytest.raises(MeshError, match=words):
        _ = file.mesh
    assert b"".join(file.pieces()) == content


def test_no_format_takes_a_vertex_beyond_its_limit():
    """Of positions that are single in some coordinates only, these are rounded."""
    far = 3000 + np.random.default_rng(0).normal(size=(300, 3))
    rows = np.zeros(300, [("x", "<f4"), ("y", "<f8"), ("z", "<f4")])
    for axis, name in enumerate(rows.dtype.names):
        rows[name] = far[:, axis]
    faces = np.zeros(100, [("n", "u1"), ("corners", "<i4", (3,))])
    faces["n"], faces["corners"] = 3, np.arange(300).reshape(-1, 3)
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 300\nproperty float x\nproperty double y\n"
        "property float z\nelement face 100\nproperty list uchar int vertex_indices\nend_header\n"
    )
    file = read(header.encode() + rows.tobytes() + faces.tobytes())
    step = np.random.default_rng(1).normal(size=(300, 3))
    step *= 1e-4 / np.linalg.norm(step, axis=1, keepdims=True)
    after = written(file.with_vertices(file.mesh.vertices + step, limit=1e-4))
    moved = read(after).positions - file.positions
    assert moved.any() and np.linalg.norm(moved, axis=1).max() <= 1e-4


@pytest.mark.parametrize("limit", [0.0, 0.4, 1.0, 1.5, 4.0])
def test_rounding_to_whole_numbers_goes_not_beyond_the_limit(tmp_path, limit):
    source, output = tmp_path / "ball.glb", tmp_path / "out.glb"
    source.write_bytes(quantized("<u1"))
    cn.denoise_file(source, output, method="laplacian", max_displacement=limit)
    moves = np.linalg.norm(cn.read(output).positions - cn.read(source).positions, axis=1)
    assert moves.max() <= limit
    assert (limit >= 1) == (moves.max() > 0)


finite = st.floats(-(2.0**99), 2.0**99, width=32)


@st.composite
def contents(draw):
    """Return meshes of a few polygons with colours and other properties."""
    kind = draw(st.sampled_from([np.float32, np.float64]))
    count = draw(st.integers(3, 8))
    positions = draw(hnp.arrays(kind, (count, 3), elements=finite, unique=True))
    corners = st.lists(st.integers(0, count - 1), min_size=3, max_size=5, unique=True)
    faces = draw(st.lists(corners, min_size=1, max_size=5))
    sizes = np.array([len(f) for f in faces])
    polygons = Polygons.from_counts(sizes, np.concatenate(faces).astype(np.int64))
    kinds = st.sampled_from([np.uint8, np.int16, np.int32, np.float32, np.float64])
    values = st.integers(0, 100)
    vertex = {n: draw(hnp.arrays(draw(kinds), count, elements=values)) for n in draw(st.sets(st.sampled_from("abc")))}
    colors = {n: draw(hnp.arrays(np.uint8, count)) for n in ("red", "green", "blue")} if draw(st.booleans()) else {}
    face = {n: draw(hnp.arrays(draw(kinds), len(faces), elements=values)) for n in draw(st.sets(st.sampled_from("de")))}
    return Content(positions, polygons, {**vertex, **colors}, face)


@settings(max_examples=60)
@given(contents(), st.sampled_from(NATIVE))
def test_encoded_content_reads_back(content, format):
    pieces, lost = FORMATS[format].encode(content)
    data = b"".join(pieces)
    file = FORMATS[format](data)
    assert written(file) == data
    again = file.content()
    if format == "stl":
        assert np.array_equal(file.positions, content.positions.astype(np.float32)[file_triangles(content)])
        return
    assert np.array_equal(again.positions.astype(content.positions.dtype), content.positions)
    assert np.array_equal(again.polygons.indptr, content.polygons.indptr)
    assert np.array_equal(again.polygons.corners, content.polygons.corners)
    for of, values in ("vertex", "vertex_values"), ("face", "face_values"):
        kept = {n: v for n, v in getattr(content, values).items() if f"{of} property '{n}'" not in lost}
        assert kept.keys() == getattr(again, values).keys()
        assert all(np.array_equal(v, getattr(again, values)[n]) for n, v in kept.items())


def file_triangles(content):
    return FORMATS["ply"](b"".join(FORMATS["ply"].encode(content)[0])).triangles.ravel()


@settings(max_examples=40)
@given(contents(), st.sampled_from(NATIVE), st.data())
def test_any_vertices_can_be_stored(content, format, data):
    file = FORMATS[format](b"".join(FORMATS[format].encode(content)[0]))
    vertices = data.draw(hnp.arrays(np.float32, file.mesh.vertices.shape, elements=finite))
    moved = FORMATS[format](written(file.with_vertices(vertices)))
    assert np.array_equal(moved.positions, vertices[file.welds])
