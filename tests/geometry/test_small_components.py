"""Small components: found by number and share, dropped from files, counted by an inspection."""

import json

import numpy as np
import pytest
from shapes import cube, icosphere

import cascadenorm as cn
from cascadenorm.api.dropped_components import without_small_components
from cascadenorm.cli import run
from cascadenorm.errors import ParameterError
from cascadenorm.geometry.small_components import component_limit, small_components
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh

LARGE, MIDDLE, SMALL = icosphere(4), icosphere(1), cube(1)  # 5120, 80 and 12 faces
PARTS = (SMALL, LARGE, MIDDLE, SMALL)


def together(*meshes):
    """The meshes side by side as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = [mesh.vertices + 5 * number for number, mesh in enumerate(meshes)]
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.vstack(vertices), np.vstack(faces))


@pytest.mark.parametrize(
    ("limit", "dropped"),
    [(1, []), (12, []), (13, [0, 3]), ("80", [0, 3]), ("81", [0, 2, 3]), (10**9, [0, 2, 3]),
     ("1%", [0, 3]), ("0.2 %", []), ("2%", [0, 2, 3]), ("100%", [0, 2, 3])],
)  # fmt: skip
def test_components_are_small_by_number_or_by_share(limit, dropped):
    mesh = together(*PARTS)
    owners = np.repeat(np.arange(4), [len(part.faces) for part in PARTS])
    faces, first = small_components(mesh, limit)
    np.testing.assert_array_equal(faces, np.isin(owners, dropped))
    np.testing.assert_array_equal(first, [np.flatnonzero(owners == number)[0] for number in dropped])


def test_a_component_with_exactly_the_share_is_not_small():
    fan = Mesh([[0, 0, 0], *([np.cos(k), np.sin(k), k] for k in range(101))], [[0, k, k + 1] for k in range(1, 101)])
    for count in range(1, 100):  # 0.07 · 100 is above 7
        mesh = together(Mesh(fan.vertices, fan.faces[:count]), fan)
        assert not small_components(mesh, f"{count}%")[0].any()
        assert small_components(mesh, f"{count}.1 %")[0].sum() == count


def test_of_components_of_one_size_all_are_the_largest():
    assert not small_components(together(SMALL, SMALL), "100%")[0].any()
    assert not small_components(together(SMALL, SMALL), 1000)[0].any()


@pytest.mark.parametrize("limit", ["", "much", "0", 0, -3, "101%", "1.5", "5 faces"])
def test_what_is_no_size_is_refused(limit):
    with pytest.raises(ParameterError, match="drop_components is"):
        component_limit(limit)


def test_an_inspection_counts_small_components_and_names_a_face_of_each():
    found = cn.inspect(together(*PARTS)).small_components
    assert (found.count, found.first) == (2, (0, 12 + 5120 + 80))
    assert cn.inspect(together(LARGE, MIDDLE)).small_components.count == 0


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".off"])
def test_denoise_leaves_them_out_and_says_so(tmp_path, monkeypatch, capsys, suffix):
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / f"scan{suffix}", together(*PARTS))
    words = ["denoise", f"scan{suffix}", "-o", f"out{suffix}", "--method", "laplacian", "--drop-components", "1%"]
    assert run([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["dropped_components"], told["dropped_faces"]) == (2, 24)
    expected = together(SMALL, LARGE, MIDDLE)  # where they lie
    kept = Mesh(expected.vertices[8:], expected.faces[12:] - 8)
    save_mesh(tmp_path / f"alone{suffix}", kept)
    cn.denoise_file(f"alone{suffix}", f"expected{suffix}", method="laplacian")
    out, alone = (cn.read(tmp_path / f"{name}{suffix}").mesh for name in ("out", "expected"))
    np.testing.assert_array_equal(out.faces, alone.faces)
    np.testing.assert_allclose(out.vertices, alone.vertices, rtol=0, atol=1e-6)
    assert run([*words, "--force"]) == 0
    assert "dropped: 2 small components of 24 faces in all" in capsys.readouterr().err
    assert run([*words[:-2], "--force"]) == 0
    assert len(cn.read(tmp_path / f"out{suffix}").mesh.faces) == len(together(*PARTS).faces)


@pytest.mark.parametrize(
    ("parts", "limit", "said"),
    [
        ((LARGE,), "1%", "dropped nothing: the mesh has 1 connected component"),
        (
            (LARGE, MIDDLE),
            "1%",
            "2 connected components, and all except the largest have at least 1% of the faces of the",
        ),
        ((LARGE, MIDDLE), "80", "2 connected components, and all except the largest have at least 80 faces"),
    ],
)
def test_denoise_says_why_it_drops_nothing(tmp_path, monkeypatch, capsys, parts, limit, said):
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / "scan.ply", together(*parts))
    words = ["denoise", "scan.ply", "--method", "laplacian", "--drop-components", limit, "--force"]
    assert run(words) == 0
    assert said in capsys.readouterr().err
    assert run([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["components"], told["dropped_components"], told["drop_components"]) == (len(parts), 0, limit)


def test_values_of_vertices_and_faces_stay_with_what_is_kept(tmp_path):
    rows = ["ply", "format ascii 1.0", "element vertex 10", *(f"property float {axis}" for axis in "xyz")]
    rows += ["property uchar red", "property uchar green", "property uchar blue", "element face 3"]
    rows += ["property list uchar int vertex_indices", "property int label", "end_header"]
    rows += [f"{i % 3} {i % 2} {i} {i} 0 0" for i in range(10)]
    rows += ["3 0 1 2 7", "4 3 4 5 6 8", "3 4 5 9 9"]  # vertices 7 and 8 are in no face
    (tmp_path / "a.ply").write_text("\n".join(rows) + "\n", encoding="ascii")
    dropped = without_small_components(cn.read(tmp_path / "a.ply"), 2, "a.ply")
    content = dropped.file.content()
    assert (dropped.components, dropped.faces) == (1, 1)
    assert content.vertex_values["red"].tolist() == list(range(3, 10))
    assert content.face_values["label"].tolist() == [8, 9]
    assert content.polygons.counts.tolist() == [4, 3] and content.polygons.corners.tolist() == [0, 1, 2, 3, 1, 2, 6]
