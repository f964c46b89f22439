"""What single formats promise: seams stay closed, normals follow, every way to write a value is read."""

import json
import re
import zipfile
from io import BytesIO

import numpy as np
import pytest
import trimesh
from sample_files import OBJ, OFF_TETRAHEDRON, PLY_TEXT, SIDES, TETRAHEDRON, glb, read, stl_binary, written
from shapes import icosphere

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.io.content import Content
from cascadenorm.io.files import FORMATS, OPTIONAL, is_mesh_name
from cascadenorm.mesh import Mesh, MeshError
from cascadenorm.mesh.polygons import Polygons


def encoded(mesh: Mesh, format: str) -> io.MeshFile:
    polygons = Polygons.from_rows(mesh.faces.astype(np.int64))
    return FORMATS[format](b"".join(FORMATS[format].encode(Content(mesh.vertices, polygons))[0]))


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


def test_obj_seam_moves_together():
    seam = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 4 6 5\n"
    file = read(seam)
    assert file.welds.tolist() == [0, 1, 2, 1, 2, 3]
    moved = file.with_vertices(file.mesh.vertices + np.arange(12).reshape(4, 3))
    assert np.array_equal(moved.positions[1], moved.positions[3])
    assert np.array_equal(moved.positions[2], moved.positions[4])


def test_obj_indices_and_continuations():
    file = read(OBJ)
    polygons = np.split(file.polygons.corners, file.polygons.indptr[1:-1])
    assert [polygon.tolist() for polygon in polygons] == [[0, 1, 2, 3], [0, 1, 4], [1, 2, 4]]


@pytest.mark.parametrize("format", ["stl", "glb", "gltf"])
def test_single_precision_is_never_exceeded(format):
    sphere = icosphere(1)
    with pytest.raises(io.OutputError, match=r"1 vertices exceed .* \(vertices 7\)"):
        encoded(sphere.moved(np.where(np.arange(len(sphere.vertices))[:, None] == 7, 1e39, sphere.vertices)), format)
    largest = float(np.finfo(np.float32).max)
    file = encoded(sphere.moved(sphere.vertices / np.abs(sphere.vertices).max() * largest), format)
    assert np.isfinite(file.positions).all()


def test_ply_strips_alternate():
    header = b"ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    header += b"element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    points = b"0 0 0\n0 1 0\n1 0 0\n1 1 0\n2 0 0\n2 1 0\n"
    file = read(header + points + b"10 0 2 1 3 -1 2 4 3 5 -1\n")
    assert file.mesh.faces.tolist() == [[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]]
    assert np.allclose(file.mesh.face_normals, (0, 0, 1))


def test_off_without_its_keyword_and_with_counts_beside_it():
    rows = OFF_TETRAHEDRON.removeprefix(b"OFF\n4 4 6\n")
    for head in (b"OFF 4 4 6\n", b"OFF\n4 4 6\n", b"4 4 6\n", b"OFF4 4 0\n", b"# first\nOFF\n4 4\n"):
        assert read(head + rows, "off").mesh.volume == pytest.approx(1 / 6)


def test_text_keeps_the_digits_of_far_coordinates():
    file = read(PLY_TEXT.replace(b"1.000 0 0", b"5000000.123456 0 0"))
    moved = read(written(file.with_vertices(file.mesh.vertices + 0.001)))
    assert moved.mesh.vertices[1, 0] == 5000000.123456 + 0.001


def test_text_beyond_single_precision_is_read_in_double():
    file = read(PLY_TEXT.replace(b"1.000 0 0", b"1e300 0 0"))
    assert file.mesh.vertices[1, 0] == 1e300
    infinite = read(PLY_TEXT.replace(b"1.000 0 0", b"inf 0 0"))
    with pytest.raises(MeshError, match="1 of 5 vertices are not finite"):
        _ = infinite.mesh


def test_colours_beyond_all_bounds_are_cut():
    file = read(OBJ.replace(b"1.0 0.5 0.25", b"1e308 -1e308 nan"))
    colors = file.content().vertex_values
    assert [colors[name][0] for name in ("red", "green", "blue")] == [255, 0, 0]


def test_text_beyond_the_type_in_its_header_can_be_converted():
    for word in (b"nan", b"-inf", b"1e300"):
        file = read(PLY_TEXT.replace(b"0 0.10 0 255", b"0 0.10 0 " + word))
        assert len(file.content().vertex_values["red"]) == 5


def test_whole_number_positions_can_move_between_whole_numbers():
    for order in ("ascii", "binary_little_endian"):
        header = f"ply\nformat {order} 1.0\nelement vertex 3\nproperty short x\nproperty short y\nproperty int z\n"
        header += "property uchar tag\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        rows = [(0, 0, 0, 7), (10, 0, 0, 8), (0, 10, 0, 9)]
        if order == "ascii":
            body = "\n".join(" ".join(map(str, row)) for row in rows).encode() + b"\n3 0 1 2\n"
        else:
            table = np.array(rows, [("x", "<i2"), ("y", "<i2"), ("z", "<i4"), ("tag", "u1")])
            body = table.tobytes() + b"\3" + np.array([0, 1, 2], "<i4").tobytes()
        file = read(header.encode() + body)
        assert written(file) == header.encode() + body
        moved = read(written(file.with_vertices(file.mesh.vertices + 0.25)))
        assert np.array_equal(moved.positions, file.positions + 0.25)
        assert moved.content().vertex_values["tag"].tolist() == [7, 8, 9]


@pytest.mark.parametrize(("kind", "one", "new"), [("char", 127, 90), ("short", 32767, 23170), ("uchar", 255, None)])
@pytest.mark.parametrize("encoding", ["ascii", "binary_big_endian"])
def test_normals_in_whole_numbers_keep_their_scale(kind, one, new, encoding):
    properties = "".join(f"property {kind} n{axis}\n" for axis in "xyz")
    header = f"ply\nformat {encoding} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    header += f"{properties}element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], float)
    if encoding == "ascii":
        body = b"".join(b"%d %d %d 0 0 %d\n" % (*row, one) for row in corners.tolist()) + b"3 0 1 2\n"
    else:
        table = np.zeros(3, [("place", ">f4", 3), ("normal", {"char": ">i1", "short": ">i2", "uchar": ">u1"}[kind], 3)])
        table["place"], table["normal"][:, 2] = corners, one
        body = table.tobytes() + b"\3" + np.arange(3, dtype=">i4").tobytes()
    corners[1, 2] = 1  # the normal is now (-1, 0, 1) / sqrt(2)
    moved = written(read(header.encode() + body).with_vertices(corners))
    values = read(moved).content().vertex_values
    normals = np.stack([values[name] for name in ("nx", "ny", "nz")], axis=1)
    assert normals.tolist() == [[0, 0, one] if new is None else [-new, 0, new]] * 3
    if encoding == "ascii":
        assert [list(map(int, row.split()[3:])) for row in moved.splitlines()[-4:-1]] == normals.tolist()


def chunks(data: bytes) -> dict[bytes, bytes]:
    found, at = {}, 12
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "little")
        found[data[at + 4 : at + 8]] = data[at + 8 : at + 8 + size]
        at += 8 + size
    return found


def test_glb_keeps_all_but_positions_normals_and_their_bounds():
    file = read(glb())
    moved = written(file.with_vertices(file.mesh.vertices * (1, 2, 3) + (0, 0, 0.5)))
    before, after = chunks(glb()), chunks(moved)
    old, new = json.loads(before[b"JSON"]), json.loads(after[b"JSON"])
    assert new["accessors"][0]["max"] == [1, 2, 0.5]
    assert new["accessors"][4]["min"] == [0, 0, 0.5]
    for document in (old, new):
        for accessor in document["accessors"]:
            accessor.pop("min", None)
            accessor.pop("max", None)
    assert old == new
    assert after[b"EXTR"] == before[b"EXTR"]
    assert after[b"BIN\0"][144:204] == before[b"BIN\0"][144:204]
    assert int.from_bytes(moved[8:12], "little") == len(moved)


def test_glb_closes_seams_and_keeps_meshes_apart():
    file = read(glb())
    assert file.welds.tolist() == [0, 1, 2, 1, 2, 3, 4, 5, 6, 7]
    assert np.allclose(file.mesh.face_normals[:, 2], (1, 1, -1, -1))
    assert file.parts.tolist() == [0] * 6 + [1] * 4


def test_glb_converts_with_its_transforms():
    content = read(glb()).content()
    assert content.positions.max(axis=0) == pytest.approx([6, 2, 0.1])
    assert len(content.polygons) == 6


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((b'"count": 4', b'"count": 9'), "past the 252 bytes"),
        ((b'"byteOffset": 12', b'"byteOffset": 8 '), "overlap"),
        ((b'"POSITION": 4', b'"POSITION": 8'), r"refers to accessors\[8\], which does not exist"),
        ((b'"type": "VEC3"', b'"type": "VEC4"'), "is not VEC3"),
        ((b'"scene": 0,', b'"scene" 0, '), "not valid glTF"),
        ((b'{"POSITION": 4}', b'["position", 4]'), "an entry has the wrong type or size: export"),
        ((b"glTF\2", b"glTF\1"), "version 1"),
    ],
)
def test_damaged_glb_is_explained(change, words):
    with pytest.raises(io.ReadError, match=words):
        read(glb().replace(*change), "glb")


def test_other_formats_go_through_trimesh(tmp_path):
    """A ZAE file is an archive with a COLLADA file in it; pycollada reads what is written as DAE."""
    pytest.importorskip("collada")
    ball = icosphere(1)
    io.write(io.from_arrays(ball.vertices, ball.faces), tmp_path / "ball.dae")
    with zipfile.ZipFile(tmp_path / "ball.zae", "w") as archive:
        archive.write(tmp_path / "ball.dae", "ball.dae")
    file = io.read(tmp_path / "ball.zae")
    assert written(file) == (tmp_path / "ball.zae").read_bytes()
    assert file.mesh.area == pytest.approx(ball.area)
    moved = file.with_vertices(file.mesh.vertices * 2)
    io.write(moved, tmp_path / "moved.ply")
    assert io.read(tmp_path / "moved.ply").mesh.area == pytest.approx(4 * ball.area)
    with pytest.raises(cn.OutputError, match="'zae' cannot be written"):
        io.write(moved, tmp_path / "moved.zae")
    with pytest.raises(io.ReadError, match="this zae file is a damaged archive"):
        read((tmp_path / "ball.zae").read_bytes()[:100], "zae")
    with zipfile.ZipFile(tmp_path / "empty.zae", "w") as archive:
        archive.writestr("empty.dae", re.sub(rb"(?s)<polylist.*</polylist>", b"", (tmp_path / "ball.dae").read_bytes()))
    with pytest.raises(io.ReadError, match="no triangle mesh"):
        io.read(tmp_path / "empty.zae")


def test_point_clouds_are_no_meshes(tmp_path):
    (tmp_path / "points.xyz").write_bytes(b"0 0 0\n1 0 0\n0 1 0\n")
    with pytest.raises(io.ReadError, match="'xyz' is not a supported mesh format"):
        io.read(tmp_path / "points.xyz")
    assert not is_mesh_name(tmp_path / "points.xyz")  # batches skip it


def test_an_stl_without_facets_has_no_faces():
    with pytest.raises(MeshError, match="no faces"):
        _ = read(b"solid nothing\nendsolid nothing\n").mesh


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


def test_what_obj_vertices_say_beyond_colours_is_named_when_it_is_left_out():
    faces = b"f 1 2 3\n"
    for rows, named in (
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", False),
        (b"v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\n", False),
        (b"v 0 0 0 2\nv 1 0 0 2\nv 0 1 0 2\n", True),
        (b"v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\n", True),
    ):
        left_out = read(rows + faces).content().left_out
        assert any("further numbers of vertices" in what for what in left_out) == named


@pytest.mark.parametrize("values", [[0, 1, 65535], [0, 1, 65536], [0, -1, 2], [0, 0.5, np.nan]])
def test_attributes_of_stl_are_named_when_they_do_not_fit(values):
    polygons = Polygons.from_rows(np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1)]))
    content = Content(np.array(TETRAHEDRON, np.float32), polygons, face_values={"attribute": np.array(values)})
    pieces, lost = FORMATS["stl"].encode(content)
    fits = values[2] == 65535
    assert ("face property 'attribute'" in lost) == (not fits)
    found = read(b"".join(pieces)).content().face_values
    assert found.get("attribute", np.zeros(0)).tolist() == (values if fits else [])


@pytest.mark.parametrize("start", [b"OFF ", b"ply\n", b"glTF", b'{"asset"', b"# vtk DataFile", b"###", b"solid "])
def test_a_binary_stl_may_begin_as_any_other_file(start):
    data = stl_binary()
    assert read(start.ljust(80) + data[80:]).format == "stl"


@pytest.mark.parametrize("change", [(b"\nv ", b"\n\tv\t"), (b"\nv ", b"\n  V "), (b"\n", b"\r")])
def test_an_obj_is_known_however_it_is_spaced(change):
    data = b"\n" + b"\n".join(b"v %d %d %d" % p for p in TETRAHEDRON) + b"\nf 1 3 2\n"
    assert read(data.replace(*change)).format == "obj"


@pytest.mark.parametrize("content", [b"<!DOCTYPE html>\n<p>v 1 2 3</p>\n", b"\x89PNG\r\n", b"hello\n", b"# v\n"])
def test_what_is_no_obj_is_refused(content):
    with pytest.raises(io.ReadError, match="not an OBJ file"):
        read(content, "obj")


def test_colours_are_fractions_where_none_reaches_2():
    points = [b"0 0 0", b"1 0 0", b"0 1 0"]
    white_first = [b"1 1 1", b"1 1 1", b"0.5 0.25 5e-01"]
    for colors, expected in (
        (white_first, [[255, 255, 255], [255, 255, 255], [128, 64, 128]]),
        ([b"1 1 1"] * 3, [[255] * 3] * 3),
        ([b"255 128.0 2", b"1 0 0", b"0 0 1"], [[255, 128, 2], [1, 0, 0], [0, 0, 1]]),
    ):
        rows = [point + b" " + color for point, color in zip(points, colors, strict=True)]
        for data in (
            b"".join(b"v " + row + b"\n" for row in rows) + b"f 1 2 3\n",
            b"COFF\n3 1 0\n" + b"\n".join(rows) + b"\n3 0 1 2\n",
            b"STCOFF\n3 1 0\n" + b" 0.5 0.5\n".join(rows) + b" 0.5 0.5\n3 0 1 2\n",
        ):
            values = read(data).content().vertex_values
            assert np.stack([values[name] for name in ("red", "green", "blue")], axis=1).tolist() == expected
            assert "alpha" not in values


@pytest.mark.parametrize(
    ("header", "values"),
    [
        (b"NCOFF", b"0 0 1 9 8 7 255"),  # as Open3D writes them
        (b"NCOFF", b"9 8 7 255 0 0 1"),  # as VCG does
        (b"CNOFF", b"0 0 1 9 8 7 255"),
        (b"NCSTOFF", b"9 8 7 255 0 0 1 .5 .5"),
        (b"STCN4OFF", b"1 0 0 1 9 8 7 255 .5 .5"),
    ],
)
def test_normals_and_colours_of_an_off_are_known_in_any_order(header, values):
    rows = [b"%d %d %d " % point + values for point in ((0, 0, 0), (1, 0, 0), (0, 1, 0))]
    file = read(header + b"\n3 1 0\n" + b"\n".join(rows) + b"\n3 0 1 2\n")
    channels = file.content().vertex_values
    assert [channels[name].tolist() for name in channels] == [[9] * 3, [8] * 3, [7] * 3, [255] * 3]
    turned = written(file.with_vertices(file.mesh.vertices @ np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)]).T))
    assert turned.split(b"\n")[2].split()[3:] == values.replace(b"0 0 1", b"0.0 1.0 0.0").split()


@pytest.mark.parametrize("kind", ["uchar", "short", "ushort", "int", "uint", "float", "double"])
def test_colours_of_a_ply_are_bytes_in_any_type(kind):
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    header += "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    expected = [[255, 128, 2], [1, 0, 0], [0, 0, 40]]
    rows = [" ".join(map(str, p + tuple(c))) + "\n" for p, c in zip(TETRAHEDRON[:3], expected, strict=True)]
    file = read((header + "".join(rows) + "3 0 1 2\n").encode())
    values = read(b"".join(FORMATS["off"].encode(file.content())[0])).content().vertex_values
    assert np.stack([values[name] for name in ("red", "green", "blue")], axis=1).tolist() == expected


@pytest.mark.parametrize("word", [b"nan(ind)", b"-nan(ind)", b"1.#QNAN", b"-1.#INF", b"1.#IND00"])
def test_numbers_that_c_spells_as_none_are_vertices_that_are_not_finite(word):
    with pytest.raises(MeshError, match="1 of 4 vertices are not finite"):
        _ = read(OFF_TETRAHEDRON.replace(b"1 0 0", word + b" 0 0", 1)).mesh


def test_off_may_be_lower_case_and_speak_of_what_it_is_not():
    for head in (b"off", b"OFF # not BINARY"):
        assert read(OFF_TETRAHEDRON.replace(b"OFF", head)).mesh.volume == pytest.approx(1 / 6)


@pytest.mark.parametrize("encoding", ["binary", "ascii"])
def test_integers_of_eight_bytes_as_trimesh_writes_them_are_kept(encoding):
    ball = icosphere(1)
    mesh = trimesh.Trimesh(ball.vertices, ball.faces, process=False)
    mesh.vertex_attributes["label"] = 2**40 + np.arange(len(ball.vertices))
    mesh.face_attributes["part"] = np.arange(len(ball.faces), dtype=np.uint64)
    data = mesh.export(file_type="ply", encoding=encoding)
    assert b"property int64 label" in data and b"property uint64 part" in data
    file = read(data)
    assert file.content().vertex_values["label"].tolist() == mesh.vertex_attributes["label"].tolist()
    moved = trimesh.load(BytesIO(written(file.with_vertices(2 * file.mesh.vertices))), "ply", process=False)
    np.testing.assert_array_equal(moved.vertices, 2 * file.positions)
    raw = moved.metadata["_ply_raw"]
    assert raw["vertex"]["data"]["label"].ravel().tolist() == mesh.vertex_attributes["label"].tolist()
    assert raw["face"]["data"]["part"].ravel().tolist() == mesh.face_attributes["part"].tolist()


def test_strips_of_a_ply_count_where_its_faces_are_empty():
    header = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += b"element face 0\nproperty list int int vertex_indices\n"
    header += b"element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    file = read(header + b"0 0 0\n0 1 0\n1 0 0\n1 1 0\n7 0 2 1 3 3 3 1\n")
    assert file.mesh.faces.tolist() == [[0, 2, 1], [1, 2, 3]]  # without what stitches strips together


@pytest.mark.parametrize("rest", [b"", b"\0\0", b"x" * 51])
def test_a_binary_stl_with_facet_in_its_header_and_bytes_behind_is_binary(rest):
    data = b"solid made by a facet".ljust(80) + stl_binary()[80:] + rest
    file = read(data)
    assert len(file.polygons) == 4
    moved = written(file.with_vertices(file.mesh.vertices + 1))
    assert moved[:80] == data[:80] and moved.endswith(rest) and len(moved) == len(data)


EXTRA = b"""ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 1 2 3
3 0 3 2
"""


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (b"1 0 0\n", b"1 0 0 9\n", "line 11 has 4 values, more than the header declares for a row of 'vertex'"),
        (b"3 0 1 3\n", b"3 0 1 3 0\n", "line 15 has 5 values, more than the header declares for a row of 'face'"),
        (b"3 0 2 1\n", b"3 0 2 1 255 0 0\n", "line 14 has 7 values"),
    ],
)
def test_a_ply_text_with_more_numbers_than_declared_is_refused_with_the_line(old, new, line):
    """Else the numbers of the next rows would be taken for others."""
    with pytest.raises(io.ReadError, match=line):
        read(EXTRA.replace(old, new))


def test_the_rows_of_a_ply_text_may_be_laid_out_in_any_way():
    expected = read(EXTRA).mesh
    head, end, rows = EXTRA.partition(b"end_header\n")
    for body in (rows.replace(b"\n", b" "), rows.replace(b" ", b"\n"), rows.replace(b"0\n1", b"0 1")):
        mesh = read(head + end + body).mesh
        assert np.array_equal(mesh.vertices, expected.vertices) and np.array_equal(mesh.faces, expected.faces)


def test_an_obj_whose_textured_faces_reference_missing_vertices_converts_isolated(tmp_path):
    """The corners of the other faces keep their texture coordinates and their normals."""
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nvn 0 0 1\nvn 0 1 0\n"
    faces = b"f 2/4/2 9/1/2 3/2/2 1/1/2\nf 1/1/1 2/2/1 3/3/1\nf 2/2/1 4/4/1 3/3/1\n"
    (tmp_path / "a.obj").write_bytes(text + faces)
    assert run(["denoise", str(tmp_path / "a.obj"), "-o", str(tmp_path / "b.ply"), "--on-bad", "isolate"]) == 0
    made = io.read(tmp_path / "b.ply")
    assert made.polygons.corners.tolist() == [0, 1, 2, 1, 3, 2]
    assert made.content().vertex_values["s"].tolist() == [0, 1, 0, 1]
    file = read(text + faces).isolating()
    moved = written(file.with_vertices(file.mesh.vertices * 2)).split(b"\n")
    assert b"vn 0 1 0" in moved  # of the face that is left as it is


@pytest.mark.parametrize("names", [("s", "t"), ("texture_u", "texture_v"), ("u", "v")])
def test_texture_coordinates_of_ply_are_converted_whatever_their_names(tmp_path, names):
    st = np.arange(8, dtype=np.float32).reshape(4, 2) / 8
    polygons = Polygons.from_rows(np.array(SIDES))
    content = Content(np.array(TETRAHEDRON, np.float32), polygons, dict(zip(names, st.T, strict=True)))
    (tmp_path / "a.ply").write_bytes(b"".join(FORMATS["ply"].encode(content)[0]))
    for name in ("a.obj", "a.glb", "a.dae"):
        assert io.write(cn.read(tmp_path / "a.ply"), tmp_path / name) == []
        found = cn.read(tmp_path / name).content().vertex_values
        np.testing.assert_array_equal(np.stack([found["s"], found["t"]], axis=1), st)
    io.write(cn.read(tmp_path / "a.ply"), tmp_path / "b.ply")
    assert set(cn.read(tmp_path / "b.ply").content().vertex_values) == set(names)
