"""COLLADA: each mesh is moved once, however many nodes show it, and everything else stays."""

import re

import numpy as np
import pytest
from sample_files import PLY_TEXT, read, written
from xml_files import COLLADA

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run


def test_instanced_nodes_of_collada_are_moved_once_and_nothing_else_changes():
    data = COLLADA.encode()
    file = read(data, "dae")
    assert written(file) == data
    assert file.positions.dtype == np.float32 and len(file.mesh.faces) == 4 and len(file.polygons) == 3
    moved = b"".join(file.with_vertices(file.mesh.vertices * np.float32((1, 1, 0.5))).pieces()).decode()
    half = 1 / np.sqrt(1 + 0.25)
    a, b = (str(np.float32(half * x)) for x in (0.5, 1))
    expected = COLLADA.replace("1 0 1  2", "1 0 0.5  2").replace("1 1 1  2", "1 1 0.5  2")
    found = re.sub(r"(?<=count=\"6\">)-[^<]+(?=<)", "-0.7071 0 0.7071 0.7071 0 0.7071", moved)
    assert found == expected
    normals = [float(word) for word in re.search(r"count=\"6\">(-\S+ \S+ \S+ \S+ \S+ [^<]+)<", moved)[1].split()]
    np.testing.assert_allclose(normals, [-float(a), 0, float(b), float(a), 0, float(b)], atol=1e-6)


def test_what_vertices_of_collada_cannot_hold_is_named_when_it_is_left_out():
    content = read(COLLADA.replace("1 4 0 4 3 0 3</p>", "1 4 0 2 3 0 3</p>").encode(), "dae").content()
    assert not content.vertex_values and "texture coordinates" in content.left_out  # vertex 4 has two
    second = '<input semantic="TEXCOORD" source="#t" offset="2" set="1"/><vcount>'
    content = read(COLLADA.replace("<vcount>", second).encode(), "dae").content()
    assert {*content.vertex_values} == {"s", "t"} and "texture coordinates" in content.left_out
    lines = '<lines count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1</p></lines></mesh>'
    assert "lines" in read(COLLADA.replace("</mesh>", lines).encode(), "dae").content().left_out


def test_colours_of_collada_keep_their_alpha():
    colors = COLLADA.replace('semantic="TEXCOORD"', 'semantic="COLOR"').replace('stride="2">', 'stride="4">')
    colors = colors.replace('"S" type="float"/>', '"R" type="float"/><param name="G" type="float"/>')
    colors = colors.replace('<param name="T"', '<param name="B" type="float"/><param name="A"')
    colors = colors.replace('"ta" count="12">0 0 1 0 2 0 0 1 1 1 2 1', '"ta" count="24">' + "1 0.2 0 0.4 " * 6)
    values = read(colors.encode(), "dae").content().vertex_values
    assert {name: value[0] for name, value in values.items()} == {"red": 255, "green": 51, "blue": 0, "alpha": 102}


def test_names_and_images_of_collada_are_known(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.dae").write_text(COLLADA)
    (tmp_path / "paint.png").write_bytes(b"picture")
    options = ["--method", "laplacian", "--only", "material=red"]
    (tmp_path / "out").mkdir()
    assert run(["denoise", "a.dae", "-o", "out/a.dae", *options]) == 0
    assert (tmp_path / "out" / "paint.png").read_bytes() == b"picture"
    assert run(["denoise", "a.dae", "-o", "out/b.dae", "--method", "laplacian", "--only", "mesh=wall"]) == 2


@pytest.mark.parametrize("uri", ["old%20paint%20&amp;%20rust.png", "./old paint &#38; rust.png"])
def test_images_of_collada_are_named_by_escaped_uris(uri, tmp_path):
    (tmp_path / "a.dae").write_text(COLLADA.replace("./paint.png", uri))
    (tmp_path / "old paint & rust.png").write_bytes(b"picture")
    (tmp_path / "out").mkdir()
    assert io.write(io.read(tmp_path / "a.dae"), tmp_path / "out" / "a.dae") == []
    assert (tmp_path / "out" / "old paint & rust.png").read_bytes() == b"picture"


@pytest.mark.parametrize(("kind", "source"), [("tristrips", "0 1 3 4"), ("trifans", "0 1 4 3")])
def test_strips_and_fans_are_triangles(kind, source):
    vertices = '<input semantic="VERTEX" source="#v" offset="0"/>'
    faces = f'<{kind} count="1">{vertices}<p>{source}</p><p>1 2 4</p></{kind}>'
    text = re.sub(r"(?s)<polylist.*</triangles>", faces, COLLADA)
    mesh = read(text.encode(), "dae").mesh
    expected = [[0, 1, 3], [1, 4, 3], [1, 2, 4]] if kind == "tristrips" else [[0, 1, 4], [0, 4, 3], [1, 2, 4]]
    assert sorted(np.roll(face, -int(np.argmin(face))).tolist() for face in mesh.faces) == sorted(expected)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ('url="#pair"/></node>\n    <node><scale>', 'url="#pair"/></node>\n    <node><skew>1</skew><scale>'),
            "'skew'",
        ),
        (("0 0 1 90", "0 0 1"), "has not 4 numbers"),
        (("<vcount>4", "<vcount>3"), "do not fit together"),
        (("<p>0 0 0", "<p>0 0 <!-- -->0"), "holds more than numbers"),
        (('count="6" stride="3"', 'count="7" stride="3"'), "announces more numbers than it holds"),
        (('count="6" stride="3"', 'count="999999999" stride="0"'), "announces more numbers than it holds"),
        (("<p>1 1", "<p>9 1"), "1 face uses vertices that do not exist"),
        (
            ("0 3 0</translate><instance_geometry", '0 3 0</translate><instance_node url="#pair"/><instance_geometry'),
            "itself",
        ),
        (("1 0 1  2", "1 0 x  2"), "'x' is not a number"),
        (('offset="1"', 'offset="-1"'), "'-1' in this COLLADA file is not a whole number"),
        (("</COLLADA>", ""), "the XML of this file is damaged"),
    ],
)
def test_damaged_collada_is_refused(change, words):
    assert change[0] in COLLADA
    with pytest.raises(cn.MeshError, match=words):
        file = read(COLLADA.replace(*change).encode(), "dae")
        _ = file.mesh, file.content()


def test_conversion_to_collada_keeps_colours_and_polygons(tmp_path):
    file = read(PLY_TEXT)
    io.write(file, tmp_path / "a.dae")
    before, after = file.content(), cn.read(tmp_path / "a.dae").content()
    assert np.array_equal(after.polygons.corners, before.polygons.corners)
    assert np.array_equal(after.positions, before.positions)
    assert all(
        np.array_equal(after.vertex_values[name], before.vertex_values[name]) for name in ("red", "green", "blue")
    )
