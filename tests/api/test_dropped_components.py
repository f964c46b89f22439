"""Small components are dropped from files of every format, with all that refers to them."""

import json

import numpy as np
import pytest
import trimesh
from components import LARGE, MIDDLE, PARTS, SMALL, in_a_row

import cascadenorm as cn
from cascadenorm.api.dropped_components import without_small_components
from cascadenorm.cli import run
from cascadenorm.errors import ParameterError, counted
from cascadenorm.io.content import Content
from cascadenorm.io.files import FORMATS
from cascadenorm.io.gltf.accessors import NewAccessors
from cascadenorm.io.gltf.document import document_of
from cascadenorm.io.gltf.gltf import GltfFile
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".off"])
def test_denoise_leaves_them_out_and_says_so(tmp_path, monkeypatch, capsys, suffix):
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / f"scan{suffix}", in_a_row(*PARTS))
    words = ["denoise", f"scan{suffix}", "-o", f"out{suffix}", "--method", "laplacian", "--drop-components", "1%"]
    assert run([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["dropped_components"], told["dropped_faces"]) == (2, 24)
    expected = in_a_row(SMALL, LARGE, MIDDLE)  # where they lie
    kept = Mesh(expected.vertices[8:], expected.faces[12:] - 8)
    save_mesh(tmp_path / f"alone{suffix}", kept)
    cn.denoise_file(f"alone{suffix}", f"expected{suffix}", method="laplacian")
    out, alone = (cn.read(tmp_path / f"{name}{suffix}").mesh for name in ("out", "expected"))
    np.testing.assert_array_equal(out.faces, alone.faces)
    np.testing.assert_allclose(out.vertices, alone.vertices, rtol=0, atol=1e-6)
    assert run([*words, "--force"]) == 0
    assert "dropped: 2 small components of 24 faces in all" in capsys.readouterr().err
    assert run([*words[:-2], "--force"]) == 0
    assert len(cn.read(tmp_path / f"out{suffix}").mesh.faces) == len(in_a_row(*PARTS).faces)


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
    save_mesh(tmp_path / "scan.ply", in_a_row(*parts))
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


@pytest.mark.parametrize(("limit", "dropped"), [(2, 0), (3, 2)])
def test_faces_of_polygons_are_counted_as_triangles(tmp_path, limit, dropped):
    corners = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0", "v -1 0 0", "v 9 0 0", "v 10 0 0", "v 10 1 0", "v 9 1 0"]
    (tmp_path / "a.obj").write_text("\n".join([*corners, "f 1 2 3 4 5", "f 6 7 8 9", ""]))
    done = cn.denoise_file(tmp_path / "a.obj", tmp_path / "out.obj", method="laplacian", drop_components=limit)
    assert (done.dropped_faces, done.faces + done.dropped_faces) == (dropped, cn.inspect(tmp_path / "a.obj").faces)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("relative", [False, True])
def test_lines_of_an_obj_file_about_what_is_kept_stay(end, relative, tmp_path):
    """A triangle is dropped whose vertices stand between those of two others with materials and textures."""
    before = [
        "# scanned",
        "mtllib paint.mtl",
        "v 0 0 0 0.5 0.5 0.5",
        "v 9 9 9",
        "v 1 0 0",
        "v 9 8 9 # far",
        "v 9 9 8",
        "",
    ]
    between = ["v 1 1 0", "v 0 1 0", "vt 0 0", "vt 1 0", "vt 1 1", "vn 0 0 1", "g near", "usemtl red"]
    far, near = ["  f 2/1 4/2 \\", "5/3 # far"], ["f 1/1/1 3/2/1 6/3/1", "usemtl green", "s off", "f 6/3/1 7/1/1 1/2/1"]
    kept = ["f 1/1/1 2/2/1 3/3/1", "usemtl green", "s off", "f 3/3/1 4/1/1 1/2/1"]
    if relative:
        far = ["  f -6/1 -4/2 \\", "-3/3 # far"]
        near = ["f -7/-3/-1 -5/-2/-1 -2/-1/-1", "usemtl green", "s off", "f -2/-1/-1 -1/-3/-1 -7/-2/-1"]
        kept = ["f 1/-3/-1 2/-2/-1 3/-1/-1", "usemtl green", "s off", "f 3/-1/-1 4/-3/-1 1/-2/-1"]
    for order, rows in ([*far, *near], kept), ([*near, *far], [*kept, ""]):
        (tmp_path / "a.obj").write_bytes(b"\xef\xbb\xbf" + end.join([*before, *between, *order]).encode())
        dropped = without_small_components(cn.read(tmp_path / "a.obj"), 2, "a.obj")
        assert (dropped.components, dropped.faces, dropped.left_out) == (1, 1, ())
        expected = [*before[:3], "v 1 0 0", "", *between, *rows]
        assert b"".join(dropped.file.pieces()) == b"\xef\xbb\xbf" + end.join(expected).encode()
        assert dropped.kept.tolist() == [row.strip().startswith("f") and row in near for row in order if "f " in row]


def test_lines_of_an_obj_file_that_use_vertices_are_left_out(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\nv 9 9 9\nv 9 8 9\nv 9 9 8\nf 5 6 7\nl 1 5\n"
    (tmp_path / "a.obj").write_text(text, encoding="ascii")
    dropped = without_small_components(cn.read(tmp_path / "a.obj"), 2, "a.obj")
    assert dropped.left_out == ("lines",) and len(dropped.file.positions) == 4


def obj_of_parts() -> bytes:
    """The parts as objects of an OBJ file: a small one, the large one with two groups, and two others."""
    mesh, lines, first = in_a_row(*PARTS), [], 0
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    for number, part in enumerate(PARTS):
        lines += [f"o part{number}"]
        for face, upper in enumerate(part.centroids[:, 2] > 0):
            lines += [f"g half{int(upper)}", "f {} {} {}".format(*(mesh.faces[first + face] + 1))]
        first += len(part.faces)
    return "\n".join(lines).encode()


def test_controls_refer_to_the_file_before_components_are_dropped(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scan.obj").write_bytes(obj_of_parts())
    count = len(in_a_row(*PARTS).vertices)
    soft = np.random.default_rng(0).random(count)
    np.save("soft.npy", soft)
    ends = LARGE.topology.edges[:50]
    np.savetxt("edges.txt", np.concatenate([SMALL.topology.edges[:3], ends + 8]))
    settings = {"method": "laplacian", "parameters": {"iterations": 5}, "force": True}
    given = {"mask": "soft.npy", "fixed": f"2,8-40,{count - 1}", "only": "half1", "creases": "edges.txt"}
    cn.denoise_file("scan.obj", "out.obj", drop_components="2%", **settings, **given)
    large = Mesh(LARGE.vertices + 5, LARGE.faces)
    halves = LARGE.centroids[:, 2] > 0
    same = {"mask": soft[8:][: len(large.vertices)], "fixed": np.arange(33), "only": halves, "creases": ends}
    expected = cn.denoise(large, method="laplacian", iterations=5, **same).vertices
    found = cn.read("out.obj").mesh.vertices
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert 0 < (found != large.vertices).any(axis=1).sum() < len(found) - 33
    arrays = {"mask": soft, "fixed": np.r_[2, 8:41], "only": np.concatenate([[False] * 12, halves, [False] * 92])}
    cn.denoise_file("scan.obj", "arrays.obj", drop_components="2%", **settings, **arrays)
    cn.denoise_file("scan.obj", "out.obj", drop_components="2%", **settings, **{**given, "creases": None})
    assert (tmp_path / "arrays.obj").read_bytes() == (tmp_path / "out.obj").read_bytes()
    with pytest.raises(ParameterError, match="references vertex 9999"):
        cn.denoise_file("scan.obj", "arrays.obj", drop_components="2%", fixed=[9999], **settings)


@pytest.mark.parametrize("suffix", [".ply", ".off", ".stl"])
def test_vertices_are_welded_where_components_are_dropped(tmp_path, suffix):
    count, upper = len(MIDDLE.vertices), MIDDLE.centroids[:, 2] > 0
    vertices = np.concatenate([MIDDLE.vertices, MIDDLE.vertices + 1e-4, SMALL.vertices + 5])
    faces = np.concatenate([MIDDLE.faces[upper], MIDDLE.faces[~upper] + count, SMALL.faces + 2 * count])
    source = tmp_path / f"scan{suffix}"
    save_mesh(source, Mesh(vertices, faces))
    done = cn.denoise_file(source, tmp_path / f"out{suffix}", method="laplacian", weld=1e-3, drop_components=20)
    assert (done.dropped_components, done.components, done.nearly_coincident) == (1, 2, 0)


def scene(*shown: int) -> bytes:
    """A glTF file with a large and a small mesh, whose scene shows the ones with these numbers."""
    vertices, faces = (np.concatenate([getattr(part, of) for part in (LARGE, SMALL)]) for of in ("vertices", "faces"))
    document, buffer, _ = document_of(Content(vertices, Polygons.from_rows(faces.astype(np.int64))))
    points, corners = document["accessors"]
    accessors = [
        {**points, "count": len(LARGE.vertices)},
        {**corners, "count": LARGE.faces.size},
        {**points, "count": len(SMALL.vertices), "byteOffset": 12 * len(LARGE.vertices)},
        {**corners, "count": SMALL.faces.size, "byteOffset": 4 * LARGE.faces.size},
    ]
    meshes = [{"primitives": [{"attributes": {"POSITION": k}, "indices": k + 1}]} for k in (0, 2)]
    nodes = [{"mesh": mesh, "translation": [5 * place, 0, 0]} for place, mesh in enumerate(shown)]
    parts = {"accessors": accessors, "meshes": meshes, "nodes": nodes, "scenes": [{"nodes": [*range(len(nodes))]}]}
    return b"".join(GltfFile._made({**document, **parts}, buffer))


@pytest.mark.parametrize("shown", [(0, 1), (1, 0), (1, 0, 1), (0, 0), (0,)])
def test_components_of_a_scene_are_dropped_where_it_shows_them(tmp_path, capsys, shown):
    source, output = tmp_path / "scene.gltf", tmp_path / "out.gltf"
    source.write_bytes(scene(*shown))
    words = ["denoise", str(source), "-o", str(output), "--method", "laplacian", "--strength", "0"]
    assert run([*words, "--drop-components", "1%"]) == 0
    small = shown.count(1)
    said = f"dropped: {counted(small, 'small component')} of" if small else "dropped nothing"
    assert said in capsys.readouterr().err
    content = cn.read(output).content()
    places = [5 * place for place, mesh in enumerate(shown) if mesh == 0]
    assert len(content.polygons) == len(places) * len(LARGE.faces)
    centres = content.positions.reshape(len(places), -1, 3).mean(axis=1)
    np.testing.assert_allclose(centres[:, 0], places, atol=1e-6)
    if small:  # which vertices the indices name is unclear where the scene moves or repeats meshes
        assert run([*words, "--force", "--drop-components", "1%", "--fixed", "0-9"]) == 2
        assert "write the file as PLY first" in capsys.readouterr().err


@pytest.mark.parametrize("format", ["gltf", "glb"])
def test_materials_of_a_gltf_file_stay_where_components_are_dropped(tmp_path, format):
    """One mesh loses a component at the front of its primitive, the other one all triangles."""
    both = in_a_row(SMALL, LARGE)
    values = {"s": both.vertices[:, 0], "t": both.vertices[:, 1]}
    document, buffer, _ = document_of(Content(both.vertices, Polygons.from_rows(both.faces.astype(np.int64)), values))
    (of_both,) = document["meshes"]
    of_both["primitives"][0]["material"] = 0
    alone = NewAccessors(document, begin=len(buffer))
    position = alone.add(SMALL.vertices.astype("<f4"), bounds=True)
    indices = alone.add(SMALL.faces.astype("<u2").reshape(-1, 1), indices=True)
    document |= {
        "materials": [{"name": "paint"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": position}, "indices": indices}]}, of_both],
        "nodes": [{"mesh": 0, "weights": []}, {"mesh": 1, "name": "scan", "scale": [2, 2, 2]}],
        "scenes": [{"nodes": [0, 1]}],
        "accessors": alone.accessors,
        "bufferViews": alone.views,
        "buffers": [{"byteLength": len(buffer) + len(alone.data)}],
    }
    source, output = tmp_path / f"a.{format}", tmp_path / f"b.{format}"
    source.write_bytes(b"".join(FORMATS[format]._made(document, buffer + bytes(alone.data))))
    done = cn.denoise_file(source, output, method="laplacian", strength=0, drop_components="1%")
    assert (done.dropped_components, done.components, done.left_out) == (2, 3, ())
    file = cn.read(output)
    made, (primitive,) = file._document, file._document["meshes"][0]["primitives"]
    assert made["materials"] == document["materials"] and primitive["material"] == 0
    assert made["nodes"] == [{}, {"mesh": 0, "name": "scan", "scale": [2, 2, 2]}]
    bounds = made["accessors"][primitive["attributes"]["POSITION"]]
    large = both.vertices[len(SMALL.vertices) :].astype(np.float32)
    assert np.array_equal([bounds["min"], bounds["max"]], [large.min(axis=0), large.max(axis=0)])
    (shown,) = trimesh.load_scene(output, process=False).geometry.values()
    assert shown.visual.material.name == "paint"
    used = np.unique(shown.faces)
    np.testing.assert_array_equal(shown.vertices[used], large)
    np.testing.assert_allclose(shown.visual.uv[used], large[:, :2], rtol=0, atol=1e-6)
    assert file.face_labels()[1].carrying("paint").all()
