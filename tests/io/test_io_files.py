"""Opening and writing files: names, streams, errors, and content that is any format or none."""

import codecs
import gzip
import io as streams
import os
import re

import numpy as np
import pytest
from commands import FAST
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_files import NATIVE, OBJ, OFF, PLY_TEXT, SAMPLES, SAMPLES_FORMAT, every_sample, read, stl_binary, written

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.io import files
from cascadenorm.io.files import FORMATS, OPTIONAL, is_mesh_name, output_format
from cascadenorm.mesh import MeshError


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


def test_missing_folder_and_unreadable_sources_are_explained(tmp_path):
    with pytest.raises(io.ReadError, match="does not exist"):
        io.read(tmp_path / "missing.ply")
    with pytest.raises(io.ReadError, match="is a folder"):
        io.read(tmp_path)
    with pytest.raises(io.ReadError, match="ply, obj, stl, off, glb"):
        read(b"\0\1\2", "docx")


@pytest.mark.parametrize("name", ["missing/a.ply", "", "a.docx"])
def test_impossible_outputs_are_explained(name, tmp_path, tetrahedron):
    with pytest.raises(io.OutputError, match=r"folder|docx"):
        io.write(tetrahedron, tmp_path / name)
    assert not os.listdir(tmp_path)


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


def test_a_stream_of_text_is_refused_in_words():
    with pytest.raises(io.ReadError, match="open the file in binary mode"):
        io.read(streams.StringIO("OFF\n"))


def outcome(data: bytes, format: str | None = None) -> str:
    """Read, weld and move; anything but success and our own errors fails the test."""
    try:
        file = read(data, format)
        assert written(file) == data
        moved = written(file.with_vertices(file.mesh.vertices + 1))
        assert np.array_equal(read(moved, file.format).positions, file.with_vertices(file.mesh.vertices + 1).positions)
    except io.ReadError as error:
        assert len(str(error)) < 1000
        return "unreadable"
    except MeshError:
        return "no mesh"
    return "read"


OUTCOMES = ("read", "unreadable", "no mesh")


@every_sample
def test_file_cut_anywhere_is_refused_or_read(data):
    format = read(data).format
    for size in range(len(data)):
        assert outcome(data[:size], format) in OUTCOMES


@pytest.mark.parametrize("name", ["ply little", "ply big", "stl binary", "glb"])
def test_binary_file_cut_anywhere_is_refused(name):
    data = SAMPLES[name]
    assert {outcome(data[:size], read(data).format) for size in range(0, len(data), 7)} == {"unreadable"}


@settings(max_examples=60)
@given(st.sampled_from(sorted(SAMPLES)), st.data())
def test_damaged_bytes_are_refused_or_read(name, data):
    content = bytearray(SAMPLES[name])
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    assert outcome(bytes(content), SAMPLES_FORMAT[name]) in OUTCOMES


@settings(max_examples=60)
@given(st.binary(max_size=200), st.sampled_from([*FORMATS, None]), st.sampled_from(sorted(SAMPLES)))
def test_random_bytes_are_refused_or_read(noise, format, name):
    assert outcome(noise, format) in OUTCOMES
    assert outcome(SAMPLES[name][: len(SAMPLES[name]) // 2] + noise, SAMPLES_FORMAT[name]) in OUTCOMES


@pytest.mark.parametrize("source", NATIVE)
@pytest.mark.parametrize("target", FORMATS)
@pytest.mark.parametrize("name", ["ply text", "obj", "off"])
def test_conversion_keeps_the_surface(name, source, target, tmp_path):
    first, second = tmp_path / f"a.{source}", tmp_path / f"b.{target}"
    io.write(read(SAMPLES[name]), first)
    lost = io.write(io.read(first), second)
    a, b = io.read(first).mesh, io.read(second).mesh
    assert b.area == pytest.approx(a.area, rel=1e-6)
    assert len(a.faces) == len(b.faces) or "stl" in (source, target)
    assert bool(lost) == (source != target and (target == "stl" or bool(lost)))


@pytest.mark.parametrize("format", ["3mf", "dae", "vtu", "vtp", "inp"])
def test_content_decides_the_format_of_xml_archives_and_grids(format, tmp_path):
    kind = {**FORMATS, **OPTIONAL}[format]
    if kind.needs[0]:
        pytest.importorskip(kind.needs[0])
    path = tmp_path / "a.ply"
    with path.open("wb") as stream:
        io.write(read(PLY_TEXT), stream, format=format)
    assert cn.read(path).format == format
    data = path.read_bytes()
    if format == "3mf":
        with pytest.raises(io.ReadError, match="the content is not a supported mesh format"):
            read(data[:-30])  # without its list of files
    if format == "inp":
        assert read(b"** a comment\n\n** and another\n" + data).format == format


def test_point_clouds_are_no_meshes(tmp_path):
    (tmp_path / "points.xyz").write_bytes(b"0 0 0\n1 0 0\n0 1 0\n")
    with pytest.raises(io.ReadError, match="'xyz' is not a supported mesh format"):
        io.read(tmp_path / "points.xyz")
    assert not is_mesh_name(tmp_path / "points.xyz")  # batches skip it


@pytest.mark.skipif(not os.path.exists("/proc/self/mem"), reason="there is no file here that not even root can read")
def test_unreadable_files_are_refused_in_words(capsys):
    assert run(["denoise", "/proc/self/mem", *FAST, "-o", "out.ply"]) == 3
    assert "cannot be read: Input/output error" in capsys.readouterr().err


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(files, "is_installed", lambda module: module != "meshio")
    monkeypatch.setattr("cascadenorm.io.via_trimesh.trimesh_formats", list)
    for format, packages in {"vtu": "meshio", "3dxml": "lxml networkx", "zae": "pycollada"}.items():
        words = re.escape(
            f"'{format}' files needs {packages}, which is not installed: pip install \"cascadenorm[formats]"
        )
        with pytest.raises(cn.MissingDependencyError, match=words):
            io.read(streams.BytesIO(b"anything"), format)
        refusal = (cn.MissingDependencyError, words) if format == "vtu" else (cn.OutputError, "cannot be written")
        with pytest.raises(refusal[0], match=refusal[1]):
            output_format(f"a.{format}")
