"""Files whose holes are filled keep all that they hold, and patches go on with what is around them."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from holed_ball import BALL, COUNT, FACES, FILLED, HOLED, SIDE, filled, ply_binary, ply_text
from shapes import grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.filled_files import fill_holes_file
from cascadenorm.cli import run
from cascadenorm.io.content import Content
from cascadenorm.io.files import FORMATS
from cascadenorm.io.gltf.gltf import GltfFile
from cascadenorm.io.hole_patches import HolePatches
from cascadenorm.io.interop import as_mesh, save_mesh
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh.polygons import Polygons


@pytest.mark.parametrize("end_of_line", ["\n", "\r\n"])
def test_every_line_of_a_ply_text_stays_and_the_new_ones_follow(tmp_path, end_of_line):
    before = ply_text(end_of_line)
    file, done = filled(tmp_path, before, ".ply")
    added = len(FILLED.faces) - FACES
    assert (done.faces, done.added, done.left_out) == (FACES, added, ())
    np.testing.assert_array_equal(file.mesh.faces, FILLED.faces)
    np.testing.assert_array_equal(file.mesh.vertices, FILLED.vertices)
    rest = file.data.splitlines()
    old = before.splitlines()
    counts = [i for i, line in enumerate(old) if line.startswith((b"element vertex", b"element face"))]
    assert [rest[i] for i in counts] == [
        b"element vertex %d" % len(FILLED.vertices),
        b"element face %d" % (FACES + added),
    ]
    where = old.index(b"end_header") + 1
    new = len(FILLED.vertices) - COUNT
    kept = rest[: where + COUNT] + rest[where + COUNT + new : where + COUNT + new + 1 + FACES] + rest[-1:]
    for i in counts:
        kept[i] = old[i]
    assert kept == old
    assert file.data.count(end_of_line.encode()) == file.data.count(b"\n")


def test_a_hole_of_one_face_needs_no_vertex(tmp_path):
    data = ply_binary("<")
    whole = PlyFile(data).with_patches(HolePatches(PlyFile(data), FILLED))
    faces = np.delete(whole.mesh.faces, 5, axis=0)
    content = replace(whole.content(), polygons=Polygons.from_rows(faces.astype(np.int64)), face_values={})
    file, done = filled(tmp_path, b"".join(PlyFile.encode(content)[0]), ".ply")
    assert done.added == 1 and len(file.positions) == len(whole.positions)
    assert_closed(file.mesh)


OBJ_STATES = "mtllib a.mtl\nvt 0 0\ns 1\ng left\nusemtl steel\n"


def obj(colors: str = "") -> bytes:
    lines = ["# kept", OBJ_STATES.rstrip()]
    lines += [f"v {x!r} {y!r} {z!r}{colors}" for x, y, z in HOLED.vertices.tolist()]
    for side in (0, 1):
        lines += ["g right", "usemtl rust"] if side else []
        lines += [f"f {a}/1 {b}/1 {c}/1" for a, b, c in (HOLED.faces[side == SIDE] + 1).tolist()]
    return "\n".join(lines).encode()  # without an end of line


@pytest.mark.parametrize("rust", ["rust", "#rust", "rust #25"])
def test_all_bytes_of_an_obj_stay_and_patches_are_of_the_group_around_them(tmp_path, rust):
    before = obj().replace(b"rust", rust.encode())
    file, done = filled(tmp_path, before, ".obj")
    assert done.left_out == () and file.data.startswith(before + b"\n")
    assert_closed(file.mesh)
    labels = {
        label.kind: np.where(label.of_faces < 0, "", label.values[label.of_faces]) for label in file.face_labels()
    }
    assert set(labels["material"][:FACES]) == {"steel", rust}
    right = file.mesh.centroids[:, 0] > 0
    clear = np.abs(file.mesh.centroids[:, 0]) > 0.1
    clear[:FACES] = False
    assert clear.sum() > 10
    np.testing.assert_array_equal(labels["material"][clear], np.where(right[clear], rust, "steel"))
    np.testing.assert_array_equal(labels["group"][clear], np.where(right[clear], "right", "left"))


@pytest.mark.parametrize(("colors", "expected"), [(" 0.25 0.5 1.0", 128), (" 10 20 30", 20), ("", None)])
def test_colours_of_an_obj_go_on(tmp_path, colors, expected):
    file, _ = filled(tmp_path, obj(colors), ".obj")
    values = file.content().vertex_values
    assert (values["green"].tolist() == [expected] * len(file.positions)) if expected else "green" not in values


def test_polygons_stay_polygons(tmp_path):
    quads = b"v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nv 0 0 2\nv 2 0 2\nv 2 2 2\nv 0 2 2\n"
    quads += b"f 4 3 2 1\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"
    file, done = filled(tmp_path, quads, ".obj")
    assert file.data.startswith(quads) and file.polygons.counts[:5].tolist() == [4] * 5
    assert done.faces == 10 and set(file.polygons.counts[5:]) == {3}
    assert_closed(file.mesh)
    ply, done = filled(tmp_path, quads, ".obj", ".ply")
    assert ply.polygons.counts[:5].tolist() == [4] * 5 and done.left_out == ()


def assert_closed(mesh):
    counts = mesh.topology.edge_faces.counts
    assert counts.min() == counts.max() == 2


@pytest.mark.parametrize("suffix", [".stl", ".off", ".glb", ".gltf"])
def test_other_formats_keep_what_others_can_take_over(tmp_path, suffix):
    source = tmp_path / f"holed{suffix}"
    content = cn.read(io.BytesIO(ply_binary("<"))).content()
    kind = FORMATS[suffix[1:]]
    source.write_bytes(b"".join(kind.encode(content)[0]))
    before = cn.read(source)
    done = fill_holes_file(source, tmp_path / f"filled{suffix}")
    after = cn.read(tmp_path / f"filled{suffix}")
    assert_closed(after.mesh)
    assert len(after.mesh.faces) == FACES + done.added == len(FILLED.faces)
    if suffix != ".stl":
        assert after.positions[:COUNT].tobytes() == before.positions.tobytes()
        for name, values in before.content().vertex_values.items():
            np.testing.assert_array_equal(after.content().vertex_values[name][:COUNT], values)


def test_what_a_scene_loses_is_said(tmp_path, capsys):
    data = b"".join(GltfFile.encode(cn.read(io.BytesIO(ply_binary("<"))).content())[0])
    (tmp_path / "holed.gltf").write_bytes(data.replace(b'"scene":0', b'"materials":[{"name":"steel"}],"scene":0'))
    assert run(["fill-holes", str(tmp_path / "holed.gltf"), "-o", str(tmp_path / "filled.ply")]) == 0
    assert "left out: materials\n" in capsys.readouterr().err


def textured(seam: bool) -> tuple[dict, bytes]:
    """Return a glTF document of the holed ball with a texture, colours and normals, and its buffer.

    Texture coordinates are those of a projection along z; behind a seam at x = 0 they are elsewhere in the picture.
    """
    vertices, faces = HOLED.vertices, HOLED.faces.astype(np.int64)
    if seam:  # vertices of faces at x > 0 are copies
        right = np.unique(faces[SIDE == 1])
        renumbered = np.full(COUNT, -1)
        renumbered[right] = COUNT + np.arange(len(right))
        faces = np.where((SIDE == 1)[:, None], renumbered[faces], faces)
        vertices = np.concatenate([vertices, vertices[right]])
    texture = 0.25 * vertices[:, :2] + 0.25 + 0.5 * (np.arange(len(vertices)) >= COUNT)[:, None]
    arrays = {
        "POSITION": (5126, "VEC3", vertices.astype("<f4")),
        "NORMAL": (5126, "VEC3", -vertices.astype("<f4")),
        "TEXCOORD_0": (5126, "VEC2", texture.astype("<f4")),
        "COLOR_0": (5121, "VEC4", np.rint(100 + 50 * vertices[:, [2, 2, 2, 2]]).astype("u1")),
        "indices": (5125, "SCALAR", faces.astype("<u4").ravel()),
        "picture": (5121, "SCALAR", np.frombuffer(b"\x89PNG picture ", "u1")),
    }
    starts = np.cumsum([0, *(len(values.tobytes()) for _, _, values in arrays.values())]).tolist()
    kinds = [(component, kind, values) for component, kind, values in arrays.values()]
    names = list(arrays)
    return {
        "asset": {"version": "2.0"},
        "images": [{"bufferView": 5, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "materials": [
            {"name": "skin", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}}
        ],
        "meshes": [
            {"primitives": [{"attributes": {n: names.index(n) for n in names[:4]}, "indices": 4, "material": 0}]}
        ],
        "nodes": [{"mesh": 0, "translation": [5, 0, 0]}],
        "scenes": [{"nodes": [0]}],
        "accessors": [
            {"bufferView": i, "componentType": c, "count": len(v), "type": kind}
            | ({"normalized": True} if i == 3 else {})
            for i, (c, kind, v) in enumerate(kinds[:5])
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": begin, "byteLength": len(v.tobytes())}
            for begin, (_, _, v) in zip(starts, kinds, strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }, b"".join(values.tobytes() for _, _, values in kinds)


def primitive_values(file, mesh: int, number: int, name: str) -> np.ndarray:
    """Return the values of an attribute of a primitive."""
    primitive = file._document["meshes"][mesh]["primitives"][number]
    return file._accessors.values(primitive["attributes"][name])


@pytest.mark.parametrize("format", ["glb", "gltf"])
def test_textures_of_gltf_stay_and_patches_continue_them(tmp_path, format):
    document, buffer = textured(seam=False)
    source = b"".join(FORMATS[format]._made(document, buffer))
    file, done = filled(tmp_path, source, f".{format}")
    assert done.left_out == () and done.closed == 1
    assert_closed(file.mesh)
    after = file._document
    assert all(after[name] == document[name] for name in ("images", "textures", "materials", "nodes", "scenes"))
    assert after["accessors"][:5] == document["accessors"] and after["bufferViews"][:6] == document["bufferViews"]
    assert bytes(file._buffers.data[: len(buffer)]) == buffer
    old, new = after["meshes"][0]["primitives"]
    assert old == document["meshes"][0]["primitives"][0] and new["material"] == 0
    assert set(new["attributes"]) == set(old["attributes"])
    positions = primitive_values(file, 0, 1, "POSITION")
    texture, normals = primitive_values(file, 0, 1, "TEXCOORD_0"), primitive_values(file, 0, 1, "NORMAL")
    inner = np.linalg.norm(positions[:, :2], axis=1) < 0.3
    assert inner.sum() > 3
    np.testing.assert_allclose(texture, 0.25 * positions[:, :2] + 0.25, atol=0.01)
    assert (normals * -positions).sum(axis=1).min() > 0.95  # inward, as those of the file
    colors = primitive_values(file, 0, 1, "COLOR_0")
    assert colors.dtype == np.uint8 and np.abs(colors[:, 0] - (100 + 50 * positions[:, 2])).max() < 8
    assert file.content().positions[:, 0].min() == pytest.approx(4, abs=0.01)


def test_a_patch_across_a_seam_of_the_texture_has_none(tmp_path, capsys):
    document, buffer = textured(seam=True)
    (tmp_path / "holed.glb").write_bytes(b"".join(FORMATS["glb"]._made(document, buffer)))
    assert run(["fill-holes", str(tmp_path / "holed.glb")]) == 0
    said = capsys.readouterr()
    assert "1 hole closed" in said.out
    assert "left out: textures on 1 patch across seams of the texture coordinates" in said.err
    file = cn.read(tmp_path / "holed_filled.glb")
    assert_closed(file.mesh)
    after = file._document
    assert after["materials"] == [
        *document["materials"],
        {"name": "skin", "pbrMetallicRoughness": {"metallicFactor": 0}},
    ]
    assert [primitive["material"] for primitive in after["meshes"][0]["primitives"]] == [0, 1]


def test_without_holes_a_file_comes_out_byte_for_byte(tmp_path):
    save_mesh(tmp_path / "ball.stl", noisy(BALL, 0.1))
    done = fill_holes_file(tmp_path / "ball.stl", tmp_path / "same.stl")
    assert (done.added, done.left_out) == (0, ())
    assert (tmp_path / "same.stl").read_bytes() == (tmp_path / "ball.stl").read_bytes()


def test_a_seam_is_no_hole(tmp_path):
    file, _ = filled(tmp_path, soup(), ".ply")
    assert_closed(file.mesh)
    assert len(file.positions) == 3 * FACES + len(FILLED.vertices) - COUNT


def soup() -> bytes:
    """The holed ball with three vertices for each face."""
    corners = Polygons.from_rows(np.arange(3 * FACES).reshape(-1, 3))
    return b"".join(PlyFile.encode(Content(HOLED.corners.reshape(-1, 3), corners))[0])


def test_numbers_too_large_for_a_file_are_refused(tmp_path):
    """Faces reference vertices by a byte, the file has 255 vertices, and the patch needs more than one."""
    ball = icosphere(2)
    vertices = np.concatenate([ball.vertices, np.full((255 - len(ball.vertices), 3), 9.0)])
    faces = ball.faces[ball.centroids[:, 2] < 0.3]
    header = ["ply", "format ascii 1.0", "element vertex 255", *(f"property float {axis}" for axis in "xyz")]
    header += [f"element face {len(faces)}", "property list uchar uchar vertex_indices", "end_header"]
    rows = [" ".join(map(str, row)) for row in [*vertices.tolist(), *([3, *face] for face in faces.tolist())]]
    (tmp_path / "small.ply").write_text("\n".join([*header, *rows]) + "\n")
    with pytest.raises(cn.OutputError, match="stores vertex indices as uchar, too small"):
        fill_holes_file(tmp_path / "small.ply", tmp_path / "out.ply")
    assert not (tmp_path / "out.ply").exists()


def test_a_holed_file_comes_back_closed(tmp_path, capsys):
    sphere = icosphere(3)
    source = tmp_path / "holed.ply"
    save_mesh(source, cn.Mesh(sphere.vertices, sphere.faces[sphere.centroids[:, 2] < 0.9]))
    assert run(["fill-holes", str(source)]) == 0
    filled = as_mesh(tmp_path / "holed_filled.ply")
    assert_closed(filled)
    assert filled.volume == pytest.approx(sphere.volume, rel=0.01)
    assert re.search(r"1 hole closed by \d+ faces, added to \d+\n", capsys.readouterr().out)
    save_mesh(source, grid(8, 8), force=True)
    assert run(["fill-holes", str(source), "--force"]) == 0
    said = capsys.readouterr().out
    assert "0 holes closed\n" in said and "an open component, 32 edges (--outer fill closes it)" in said
    assert run(["fill-holes", str(source), "--force", "--outer", "fill", "--max-edges", "9"]) == 0
    assert "1 hole of more than 9 edges (--max-edges)" in capsys.readouterr().out
    assert run(["fill-holes", str(source), "--force", "--outer", "fill"]) == 0
    assert "1 hole closed" in capsys.readouterr().out
    save_mesh(source, cn.Mesh(sphere.vertices, sphere.faces[sphere.centroids[:, 2] < 0.9]), force=True)
    cn.write(cn.read(source), tmp_path / "holed.stl")
    (tmp_path / "holed.stl").rename(tmp_path / "bare")
    assert run(["fill-holes", str(tmp_path / "bare")]) == 0
    assert cn.read(tmp_path / "bare_filled").format == "stl"


def test_an_existing_output_stays(tmp_path, capsys):
    source = tmp_path / "mesh.obj"
    save_mesh(source, icosphere(1))
    before = source.read_bytes()
    assert run(["fill-holes", str(source), "-o", str(source)]) == 5
    assert source.read_bytes() == before
    assert "exists already" in capsys.readouterr().err
