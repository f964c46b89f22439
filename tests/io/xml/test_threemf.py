"""3MF: each mesh is moved once, however often and deeply it is nested, and everything else stays."""

import io as streams
import zipfile

import numpy as np
import pytest
from sample_files import read, written
from shapes import icosphere
from xml_files import CORE, MODEL, archive, entries, mesh_3mf, nested_3mf

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run


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


def test_another_damaged_file_in_a_3mf_archive_is_refused_when_it_is_to_be_kept():
    made = streams.BytesIO(nested_3mf())
    with zipfile.ZipFile(made, "a") as archive:
        archive.writestr("note.txt", b"kept as it is")  # stored without compression
    file = read(made.getvalue().replace(b"kept as it is", b"Kept as it is"), "3mf")
    with pytest.raises(io.ReadError, match="another file in this 3mf archive is damaged"):
        written(file.with_vertices(file.mesh.vertices + 1))


def test_an_archive_whose_build_shows_nothing_is_a_library_of_its_meshes(tmp_path):
    item = '<item objectid="2"/>'
    (tmp_path / "a.3mf").write_bytes(archive((MODEL % item).replace('object id="1"', 'object id=""')))
    file = cn.read(tmp_path / "a.3mf")
    assert len(file.content().polygons) == 1
    cn.write(file, tmp_path / "a.ply")
    assert len(cn.read(tmp_path / "a.ply").mesh.faces) == 1
