"""Colours, texture coordinates and positions mean the same in every format."""

import numpy as np
import pytest
from sample_files import OBJ, SIDES, TETRAHEDRON, read
from shapes import icosphere

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.io.content import Content
from cascadenorm.io.files import FORMATS
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons


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


def test_colours_beyond_all_bounds_are_cut():
    file = read(OBJ.replace(b"1.0 0.5 0.25", b"1e308 -1e308 nan"))
    colors = file.content().vertex_values
    assert [colors[name][0] for name in ("red", "green", "blue")] == [255, 0, 0]


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


def encoded(mesh: Mesh, format: str) -> io.MeshFile:
    polygons = Polygons.from_rows(mesh.faces.astype(np.int64))
    return FORMATS[format](b"".join(FORMATS[format].encode(Content(mesh.vertices, polygons))[0]))


@pytest.mark.parametrize("format", ["stl", "glb", "gltf"])
def test_single_precision_is_never_exceeded(format):
    sphere = icosphere(1)
    with pytest.raises(io.OutputError, match=r"1 vertices exceed .* \(vertices 7\)"):
        encoded(sphere.moved(np.where(np.arange(len(sphere.vertices))[:, None] == 7, 1e39, sphere.vertices)), format)
    largest = float(np.finfo(np.float32).max)
    file = encoded(sphere.moved(sphere.vertices / np.abs(sphere.vertices).max() * largest), format)
    assert np.isfinite(file.positions).all()
