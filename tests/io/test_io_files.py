"""Opening and writing files: names, streams, errors, and files that are whole or absent."""

import codecs
import gzip
import io as streams
import os
import re
import stat
import tracemalloc

import numpy as np
import pytest
from sample_files import COFF, OBJ, OFF, PLY_TEXT, SAMPLES, SAMPLES_FORMAT, read, stl_binary, written

from cascadenorm import io
from cascadenorm.mesh import MeshError


@pytest.fixture
def tetrahedron():
    return io.from_arrays(np.eye(4)[:, :3], [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)])


@pytest.mark.parametrize("name", SAMPLES)
@pytest.mark.parametrize("extension", ["ply", "obj", "stl", "off", "xyz", "", "PLY"])
def test_content_decides_the_format(name, extension, tmp_path):
    path = tmp_path / f"a.{extension}"
    path.write_bytes(SAMPLES[name])
    assert io.read(path).format == SAMPLES_FORMAT[name]


def test_odd_file_names(tmp_path, tetrahedron):
    path = tmp_path / "Ärger mit  spaces # and (more).Ply"
    assert io.write(tetrahedron, path) == []
    assert np.array_equal(io.read(str(path)).mesh.vertices, tetrahedron.mesh.vertices)


def test_streams_carry_any_format(tetrahedron):
    stream = streams.BytesIO()
    io.write(tetrahedron, stream, format="off")
    assert stream.getvalue().startswith(b"OFF\n")
    assert io.read(streams.BytesIO(stream.getvalue())).format == "off"


@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8", ">f8"])
def test_arrays_keep_their_type(kind):
    vertices = np.random.default_rng(0).normal(size=(4, 3)).astype(kind)
    file = io.from_arrays(vertices, [(0, 1, 2), (0, 2, 3)])
    assert file.positions.dtype == np.dtype(kind).newbyteorder("=")
    assert np.array_equal(file.positions, vertices)


@pytest.mark.parametrize("format", io.files.FORMATS)
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_arrays_are_written_as_a_ply_file_of_them_is(kind, format):
    vertices = np.random.default_rng(0).normal(size=(4, 3)).astype(kind)
    arrays = io.from_arrays(vertices, [(0, 1, 2), (0, 2, 3)])
    ply = io.read(streams.BytesIO(b"".join(arrays.pieces())))
    assert ply.positions.dtype == kind
    assert arrays.with_vertices(vertices + 1).data == arrays.data == ply.data
    for file, other in ((arrays, ply), (arrays.with_vertices(vertices + 1), ply.with_vertices(vertices + 1))):
        mine, theirs = streams.BytesIO(), streams.BytesIO()
        assert io.write(file, mine, format=format) == io.write(other, theirs, format=format)
        assert mine.getvalue() == theirs.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\n\n", "not a supported mesh format"),
        (b"just some text\n", "not a supported mesh format"),
        (OBJ.decode().encode("utf-16"), "UTF-16, which is not supported: save it as UTF-8"),
        (gzip.compress(PLY_TEXT), "compressed by gzip: unpack it first"),
        (PLY_TEXT[:300], "end_header|truncated"),
        (PLY_TEXT.replace(b"vertex 5", b"vertex 1000000000000"), "1000000000000 rows of 'vertex'.*truncated"),
        (PLY_TEXT.replace(b"face 3", b"face 999999999999"), "999999999999 rows of 'face'"),
        (PLY_TEXT.replace(b"0.25", b"zero"), "line 21: 'zero' is not a number"),
        (PLY_TEXT.replace(b"property float x", b"property float16 x"), "line 6 .*float16"),
        (PLY_TEXT.replace(b"property float x", b"property float u"), "x, y and z"),
        (PLY_TEXT.replace(b"element edge 1", b"element vertex 1"), "more than one element 'vertex'"),
        (PLY_TEXT.replace(b"3 0 1 4 8", b"3 0 1.5 4 8"), "vertex 1.5"),
        (stl_binary()[:200], "4 triangles.*within number 2"),
        (b"solid\nvertex 0 0 0\nendsolid # facet\n", "line 2: this vertex is outside any facet"),
        (b"solid\nfacet\nvertex 0 0 0\nendfacet\nendsolid\n", "line 2: this facet does not have three vertices"),
        (OFF.replace(b"5 4 0", b"5 4000000000000 0"), "4000000000000 faces"),
        (OFF.replace(b"5 4 0", b"-5 4 0"), "-5 vertices"),
        (OFF[: OFF.index(b"4 0")], r"line 3 has '5' instead of the counts of vertices and faces: .*truncated"),
        (OFF[: OFF.index(b"1 0 0")], "declares 5 vertices and 4 faces, a line each, but only 1 line follows"),
        (OFF[: OFF.index(b" 2 3 4 1 1 1")], "line 13 has 1 value and needs 4"),
        (OFF.replace(b"4 0 1 2 3 255 0 0", b"4 0 1"), "line 10 has 3 values and needs 5"),
        (OFF.replace(b"4 0 1 2 3", b"-4 0 1 2 3"), "line 10: a face has -4 vertices"),
        (OFF.replace(b"4 0 1 2 3", b"-4 0 1 2 3").replace(b"3 1 2 4", b"-7 1 2 4"), "line 10: a face has -4 vertices"),
        (OBJ.replace(b"v 0 1 0 1.0 0.5 0.25", b"v 0 1"), "line 7 has 3 values and needs 4"),
        (OBJ.replace(b"f 2 3 5", b"f 2 x 5"), "line 21: 'x' is not a number"),
    ],
)
def test_unreadable_content_is_explained(content, words, tmp_path):
    path = tmp_path / "some.mesh"
    path.write_bytes(content)
    with pytest.raises(io.ReadError, match=rf"(?s)some\.mesh: .*({words})"):
        io.read(path)


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


def test_lying_header_allocates_nothing():
    data = b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\nproperty float x\nproperty float y\n"
    lists = b"property float z\nelement face 3\nproperty list uint int vertex_indices\nend_header\n"
    for lie in (data + lists + bytes(64), data.replace(b"1000000000000", b"3") + lists + bytes(36) + b"\xff" * 20):
        tracemalloc.start()
        with pytest.raises(io.ReadError):
            read(lie)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
        tracemalloc.stop()


def test_missing_folder_and_unreadable_sources_are_explained(tmp_path):
    with pytest.raises(io.ReadError, match="does not exist"):
        io.read(tmp_path / "missing.ply")
    with pytest.raises(io.ReadError, match="is a folder"):
        io.read(tmp_path)
    with pytest.raises(io.ReadError, match="ply, obj, stl, off, glb"):
        read(b"\0\1\2", "docx")


def test_existing_file_needs_force(tmp_path, tetrahedron):
    path = tmp_path / "a.ply"
    path.write_bytes(b"precious")
    with pytest.raises(io.OutputError, match="force"):
        io.write(tetrahedron, path)
    assert path.read_bytes() == b"precious"
    path.chmod(0o640)
    io.write(tetrahedron, path, force=True)
    assert len(io.read(path).mesh.faces) == 4
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert os.listdir(tmp_path) == ["a.ply"]


@pytest.mark.parametrize("name", ["missing/a.ply", "", "a.docx"])
def test_impossible_outputs_are_explained(name, tmp_path, tetrahedron):
    with pytest.raises(io.OutputError, match=r"folder|docx"):
        io.write(tetrahedron, tmp_path / name)
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize("force", [True, False])
def test_failing_write_leaves_everything_as_it_was(force, tmp_path, tetrahedron, monkeypatch):
    path = tmp_path / "a.ply"
    if force:
        path.write_bytes(b"precious")

    def full_disk(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(io.OutputError, match="No space left"):
        io.write(tetrahedron, path, force=force)
    assert os.listdir(tmp_path) == (["a.ply"] if force else [])
    assert not force or path.read_bytes() == b"precious"


def test_interrupted_write_leaves_nothing(tmp_path, tetrahedron, monkeypatch):
    def interrupt(handle):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        io.write(tetrahedron, tmp_path / "a.ply")
    assert not os.listdir(tmp_path)


def test_file_that_appears_meanwhile_is_not_overwritten(tmp_path, tetrahedron, monkeypatch):
    path = tmp_path / "a.ply"
    monkeypatch.setattr(os, "fsync", lambda handle: path.write_bytes(b"precious"))
    with pytest.raises(io.OutputError, match="another process created"):
        io.write(tetrahedron, path)
    assert os.listdir(tmp_path) == ["a.ply"]
    assert path.read_bytes() == b"precious"


def test_link_is_followed(tmp_path, tetrahedron):
    (tmp_path / "real.ply").write_bytes(b"old")
    (tmp_path / "link.ply").symlink_to("real.ply")
    io.write(tetrahedron, tmp_path / "link.ply", force=True)
    assert (tmp_path / "link.ply").is_symlink()
    assert len(io.read(tmp_path / "real.ply").mesh.faces) == 4


def test_device_is_written_to_and_not_replaced(tetrahedron):
    io.write(tetrahedron, os.devnull, format="ply")
    assert not stat.S_ISREG(os.stat(os.devnull).st_mode)


def test_a_long_obj_is_known_without_its_name():
    data = b"# scan\n" + b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" * 10_000 + b"f 1 2 3\n"
    assert io.read(streams.BytesIO(data)).format == "obj"


@pytest.mark.parametrize("name", [name for name in SAMPLES if "binary" not in name and name != "glb"])
def test_a_byte_order_mark_is_no_part_of_the_mesh(name):
    marked, plain = (io.read(streams.BytesIO(mark + SAMPLES[name])) for mark in (codecs.BOM_UTF8, b""))
    assert marked.format == plain.format
    np.testing.assert_array_equal(marked.positions, plain.positions)
    np.testing.assert_array_equal(marked.triangles, plain.triangles)
    assert written(marked) == codecs.BOM_UTF8 + SAMPLES[name]
    moved = [file.with_vertices(file.mesh.vertices + 1) for file in (marked, plain)]
    assert written(moved[0]) == codecs.BOM_UTF8 + written(moved[1])
    np.testing.assert_array_equal(moved[0].content().positions, moved[1].content().positions)


def test_the_header_of_a_binary_stl_may_begin_as_it_likes():
    data = codecs.BOM_UTF8 + stl_binary()[3:]
    assert len(io.read(streams.BytesIO(data)).triangles) == len(io.read(streams.BytesIO(stl_binary())).triangles)


def test_a_stream_of_text_is_refused_in_words():
    with pytest.raises(io.ReadError, match="open the file in binary mode"):
        io.read(streams.StringIO("OFF\n"))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("far", "vertices have shape ()"),
        ([[1], [2, 3]], "vertices are a list whose rows have different lengths"),
        (np.full((4, 3), "1"), "vertices have type <U1; they must be numbers"),
        (np.ones((4, 3), complex), "vertices have type complex128; they must be numbers"),
    ],
)
def test_only_numbers_can_be_vertices_of_a_file(given, words, tetrahedron):
    with pytest.raises(MeshError, match=re.escape(words)):
        tetrahedron.with_vertices(given)
