"""3MF and COLLADA: each mesh is moved once, however often and deeply it is nested, and everything else stays."""

import io as streams
import re
import zipfile

import numpy as np
import pytest
from sample_files import PLY_TEXT, read, written
from shapes import icosphere
from xml_files import COLLADA, CORE, FACES, TETRAHEDRON, entries, mesh_3mf, nested_3mf

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.io.content import Content
from cascadenorm.io.xml.collada import ColladaFile
from cascadenorm.io.xml.threemf import ThreemfFile
from cascadenorm.mesh.polygons import Polygons


def shown(file) -> np.ndarray:
    """Return the least corner of each tetrahedron that a scene shows."""
    return file.content().positions.reshape(-1, 4, 3).min(axis=1)


def test_nested_components_of_3mf_are_moved_once_and_nothing_else_changes():
    data = nested_3mf()
    file = read(data, "3mf")
    assert written(file) == data
    assert len(file.mesh.faces) == 4  # shown four times
    assert shown(file).tolist() == [[0, 0, 0], [2, 0, 0], [-1, 5, 0], [-3, 5, 0]]
    assert file.content().left_out == ("the unit",)
    moved = b"".join(file.with_vertices(file.mesh.vertices * (1, 1, 2.5)).pieces())
    before, after = entries(data), entries(moved)
    assert before.keys() == after.keys() and after["Metadata/plate.png"] == before["Metadata/plate.png"]
    assert after["3D/3dmodel.model"] == before["3D/3dmodel.model"].replace(b"z='1'", b"z='2.5'")
    again = read(moved, "3mf")
    assert shown(again).tolist() == shown(file).tolist()
    assert again.content().positions[:, 2].max() == 2.5


def test_faces_of_mirrored_components_are_reversed():
    content = read(nested_3mf(), "3mf").content()
    corners = content.positions[content.polygons.corners.reshape(-1, 3)]
    volumes = np.linalg.det(corners).reshape(4, 4).sum(axis=1) / 6
    np.testing.assert_allclose(volumes, 1 / 6)


def test_objects_of_other_models_in_the_archive_are_moved_as_well():
    """Slicers put each object into a model of its own, and count its ids anew."""
    other = f'<model unit="inch" xmlns="{CORE}"><resources>{mesh_3mf(1)}{mesh_3mf(2)}</resources><build/></model>'
    data = nested_3mf({"3D/Objects/other.model": other})
    use = '<component objectid="1"/>'
    root = entries(data)["3D/3dmodel.model"].decode()
    root = root.replace(use, '<component objectid="2" p:path="/3D/Objects/other.model"/>')
    data = nested_3mf({"3D/3dmodel.model": root, "3D/Objects/other.model": other})
    file = read(data, "3mf")
    assert len(file.mesh.faces) == 12 and len(shown(file)) == 4
    labels = file.face_labels()[0]
    assert labels.values.tolist() == ["part 1", "part 1", "part 2"]
    moved = entries(b"".join(file.with_vertices(file.mesh.vertices + np.array((0, 0, 3))).pieces()))
    for name in ("3D/3dmodel.model", "3D/Objects/other.model"):
        assert b"z='4'" in moved[name] or b"z='4.0'" in moved[name]


def test_3mf_is_read_by_trimesh_as_it_is_here(tmp_path):
    pytest.importorskip("lxml")
    pytest.importorskip("networkx")
    import trimesh

    ball = icosphere(2)
    io.write(io.from_arrays(ball.vertices, ball.faces), tmp_path / "a.3mf")
    assert run(["denoise", str(tmp_path / "a.3mf"), "-o", str(tmp_path / "b.3mf"), "--method", "laplacian"]) == 0
    found = trimesh.load_mesh(tmp_path / "b.3mf", process=False)
    expected = cn.denoise(cn.read(tmp_path / "a.3mf").mesh, method="laplacian")
    assert np.array_equal(found.faces, expected.faces)
    np.testing.assert_allclose(found.vertices, expected.vertices, rtol=1e-15)
    assert np.array_equal(cn.read(tmp_path / "b.3mf").positions, found.vertices)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((b'objectid="3"/>', b'objectid="4"/>'), "contains itself"),
        ((b"1 0 0 0 1 0 0 0 1 2 0 0", b"1 0 0"), "has not 12 numbers"),
        ((b'y="1"', b'w="1"'), "lacks the attribute 'y'"),
        ((b'y="1"', b'y="one"'), "XML of this file is damaged: .*one"),
        ((b'v1="0"', b'v1="99999999999999999999"'), "too large"),
        ((b'v1="0"', b'v1="4"'), "3 faces use vertices that do not exist"),
        ((b"</model>", b""), "XML of this file is damaged"),
        ((b"<model", b"<!DOCTYPE a [<!ENTITY b 'c'>]><model"), "declares a document type"),
        ((b"<mesh>", b"<other>"), "XML of this file is damaged"),
    ],
)
def test_damaged_3mf_is_refused(change, words):
    model = entries(nested_3mf())["3D/3dmodel.model"]
    assert change[0] in model
    with pytest.raises(cn.MeshError, match=words):
        file = read(nested_3mf({"3D/3dmodel.model": model.replace(*change).decode()}), "3mf")
        _ = file.mesh, file.content()


def test_components_that_multiply_are_refused():
    """Each of 40 objects contains the one before twice."""
    doubled = "".join(
        f'<object id="{n}"><components>{2 * f"""<component objectid="{n - 1}"/>"""}</components></object>'
        for n in range(2, 42)
    )
    build = '<build><item objectid="41"/></build>'
    model = f'<model xmlns="{CORE}"><resources>{mesh_3mf(1)}{doubled}</resources>{build}</model>'
    file = read(nested_3mf({"3D/3dmodel.model": model}), "3mf")
    assert len(file.mesh.faces) == 4
    with pytest.raises(io.ReadError, match="the meshes that the scene of this file shows need"):
        file.content()


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


def test_collada_is_shown_where_its_nodes_put_it():
    content = read(COLLADA.encode(), "dae").content()
    assert content.positions.shape == (30, 3)
    assert content.left_out == ("textures", "normals", "the unit", "the up axis")
    roof = np.array([(0, 0, 0), (1, 0, 1), (2, 0, 0), (0, 1, 0), (1, 1, 1), (2, 1, 0)], float)
    turned = np.stack([10 - roof[:, 1], roof[:, 0], roof[:, 2]], axis=1)
    places = [turned, turned - (3, 0, 0), roof * (-1, 1, 1), roof * (-1, 1, 1) + (0, 3, 0), roof + np.array((0, 0, 7))]
    np.testing.assert_allclose(content.positions.reshape(5, 6, 3), places, atol=1e-6)
    assert content.polygons.counts.tolist() == [4, 3, 3] * 5
    assert content.vertex_values["s"].tolist() == [0, 1, 2, 0, 1, 2] * 5
    assert content.vertex_values["t"].tolist() == [0, 0, 0, 1, 1, 1] * 5
    triangles = content.positions[content.polygons.corners[content.polygons.owners % 3 == 1]].reshape(-1, 3, 3)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert (normals[:, 2] > 0).all()  # those of mirrored nodes are reversed


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


def test_cameras_of_collada_may_stand_anywhere():
    camera = '<node><lookat>0 0 1 0 0 0 0 1 0</lookat><instance_camera url="#c"/></node></visual_scene>'
    assert len(read(COLLADA.replace("</visual_scene>", camera).encode(), "dae").content().positions) == 30


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


@pytest.mark.parametrize("kind", [ColladaFile, ThreemfFile])
@pytest.mark.parametrize("number", [np.float32, np.float64])
def test_any_vertices_are_stored(kind, number):
    rng = np.random.default_rng(0)
    values = (rng.normal(size=(4, 3)) * 10.0 ** rng.integers(-20, 20, (4, 3))).astype(number)
    content = Content(np.array(TETRAHEDRON, number), Polygons.from_rows(np.array(FACES)))
    file = kind(b"".join(kind.encode(content)[0]))
    file = kind(b"".join(file.with_vertices(values.astype(file.positions.dtype)).pieces()))
    assert np.array_equal(file.positions, values.astype(np.float32))
    wide = kind(b"".join(kind.encode(Content(values, content.polygons))[0]))
    assert np.array_equal(wide.positions, values)


def test_another_damaged_file_in_a_3mf_archive_is_refused_when_it_is_to_be_kept():
    made = streams.BytesIO(nested_3mf())
    with zipfile.ZipFile(made, "a") as archive:
        archive.writestr("note.txt", b"kept as it is")  # stored without compression
    file = read(made.getvalue().replace(b"kept as it is", b"Kept as it is"), "3mf")
    with pytest.raises(io.ReadError, match="another file in this 3mf archive is damaged"):
        written(file.with_vertices(file.mesh.vertices + 1))
