"""Masks, fixed vertices, faces and creases are found by their names in a file."""

import json
import re
import struct
from pathlib import Path

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.selection import labelled_faces, resolve_controls
from cascadenorm.io.content import CHANNELS, Content
from cascadenorm.io.gltf.document import document_of
from cascadenorm.io.gltf.gltf import GltfFile
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.io.xml.collada import ColladaFile
from cascadenorm.mesh.polygons import Polygons
from cascadenorm.registry.controls import checked_controls

BALL = noisy(icosphere(2), 0.1)
COUNT = len(BALL.vertices)
RNG = np.random.default_rng(0)
FAST = {"method": "laplacian"}
PAINT = RNG.integers(0, 256, COUNT).astype(np.uint8)
SOFT = RNG.random(COUNT).astype(np.float32)
PARTS = np.arange(len(BALL.faces), dtype=np.int32) % 3 // 2


@pytest.fixture
def ball(tmp_path, monkeypatch):
    """A working directory with a PLY file that carries masks and numbers of parts."""
    monkeypatch.chdir(tmp_path)
    content = Content(
        BALL.vertices,
        Polygons.from_rows(BALL.faces.astype(np.int64)),
        {"paint": PAINT, "quality": SOFT, "height": 5 * SOFT, "chosen": (SOFT > 0.5).astype(np.uint8)},
        {"part": PARTS},
    )
    (tmp_path / "ball.ply").write_bytes(b"".join(PlyFile.encode(content)[0]))
    return cn.read("ball.ply")


def denoised(source: str = "ball.ply", **controls) -> np.ndarray:
    cn.denoise_file(source, "out.ply", force=True, **FAST, **controls)
    return cn.read("out.ply").mesh.vertices


def expected(mesh=BALL, **controls) -> np.ndarray:
    return cn.denoise(mesh, **FAST, **controls).vertices


def test_a_mask_is_an_attribute_a_file_or_an_array(ball):
    np.save("soft.npy", SOFT)
    np.savetxt("soft.txt", SOFT, header="painted", encoding="utf-8-sig")
    by_hand = expected(mask=SOFT)
    for mask in ("quality", "soft.npy", Path("soft.npy"), SOFT, SOFT.tolist()):
        np.testing.assert_array_equal(denoised(mask=mask), by_hand)
    np.testing.assert_allclose(denoised(mask="soft.txt"), by_hand, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(denoised(mask="paint"), expected(mask=PAINT / 255))
    np.testing.assert_array_equal(denoised(mask="chosen"), expected(mask=SOFT > 0.5))
    path = cn.denoise("ball.ply", mask="quality", **FAST)
    np.testing.assert_array_equal(cn.read(path).mesh.vertices, by_hand)


def test_colours_are_masks_too(ball):
    rows = [f"v {x} {y} {z} {r / 255} 0 1\n" for (x, y, z), r in zip(BALL.vertices.tolist(), PAINT, strict=True)]
    rows += ["f {} {} {}\n".format(*face) for face in BALL.faces + 1]
    with open("ball.obj", "w", encoding="ascii") as file:
        file.writelines(rows)
    np.testing.assert_array_equal(denoised("ball.obj", mask="red"), expected(mask=PAINT / 255))
    np.testing.assert_array_equal(denoised("ball.obj", mask="blue"), expected())
    np.testing.assert_array_equal(denoised("ball.obj", mask="green"), BALL.vertices)


def test_a_file_of_weights_is_not_scaled_whatever_its_type(ball):
    held = (SOFT > 0.5).astype(np.uint8)
    np.save("held.npy", held)
    np.testing.assert_array_equal(denoised(mask="held.npy"), expected(mask=held))
    np.save("paint.npy", PAINT)
    with pytest.raises(cn.ParameterError, match="weights that are not within 0 … 1"):
        denoised(mask="paint.npy")


def test_fixed_is_numbers_an_attribute_or_a_file(ball):
    numbers = [0, 5, *range(7, 21)]
    np.save("numbers.npy", numbers)
    with open("numbers.txt", "w", encoding="ascii") as file:
        file.write("\n".join(map(str, numbers)))
    by_hand = expected(fixed=numbers)
    for fixed in ("0,5,7-20", " 0, 5 ,20 - 7 ", "numbers.npy", "numbers.txt", numbers):
        np.testing.assert_array_equal(denoised(fixed=fixed), by_hand)
    np.testing.assert_array_equal(denoised(fixed="paint"), expected(fixed=PAINT != 0))


def test_a_file_of_truths_says_which_are_fixed(ball):
    held = SOFT > 0.5
    np.save("held.npy", held)
    np.testing.assert_array_equal(denoised(fixed="held.npy"), expected(fixed=held))


def test_creases_are_an_angle_or_a_file(ball):
    pairs = BALL.topology.edges[10:40]
    np.save("pairs.npy", pairs)
    np.savetxt("pairs.txt", pairs, fmt="%d")
    for creases in ("pairs.npy", "pairs.txt", pairs):
        np.testing.assert_array_equal(denoised(creases=creases), expected(creases=pairs))
    np.testing.assert_array_equal(denoised(creases="40"), expected(creases=40))


def test_copies_at_a_seam_have_the_smallest_weight_and_are_fixed_together(tmp_path, monkeypatch):
    """A sheet in two halves, each with its own copies of the vertices between them."""
    monkeypatch.chdir(tmp_path)
    sheet = noisy(grid(4, 4), 0.1)
    left = sheet.centroids[:, 0] < 2
    used = [np.unique(sheet.faces[half]) for half in (left, ~left)]
    corners = [np.searchsorted(rows, sheet.faces[half]) for rows, half in zip(used, (left, ~left), strict=True)]
    owners = np.concatenate(used)
    faces = np.concatenate([corners[0], corners[1] + len(used[0])])
    weights = RNG.random(len(owners))
    content = Content(sheet.vertices[owners], Polygons.from_rows(faces.astype(np.int64)), {"w": weights})
    (tmp_path / "sheet.ply").write_bytes(b"".join(PlyFile.encode(content)[0]))
    file = cn.read("sheet.ply")
    assert len(owners) == len(sheet.vertices) + 5 == len(file.mesh.vertices) + 5
    smallest = np.ones(len(file.mesh.vertices))
    for copy, weight in zip(file.welds, weights, strict=True):
        smallest[copy] = min(smallest[copy], weight)
    for mask in ("w", weights, smallest):
        np.testing.assert_array_equal(resolve_controls(checked_controls({"mask": mask}), file)["mask"], smallest)
    last = len(owners) - 1
    assert resolve_controls(checked_controls({"fixed": str(last)}), file)["fixed"].tolist() == [file.welds[last]]
    one = np.arange(len(owners)) == last
    np.testing.assert_array_equal(
        np.flatnonzero(resolve_controls(checked_controls({"fixed": one}), file)["fixed"]), file.welds[[last]]
    )


def test_arrays_refer_to_the_mesh_before_its_vertices_are_welded(tmp_path, monkeypatch):
    """A sheet in two halves, whose copies of the vertices between them differ by rounding."""
    monkeypatch.chdir(tmp_path)
    sheet = noisy(grid(4, 4), 0.1)
    right = sheet.centroids[:, :1] > 2
    halves = np.concatenate([sheet.vertices, sheet.vertices + 1e-5]), sheet.faces + right * len(sheet.vertices)
    cn.write(halves, "halves.ply")
    fixed = np.unique(halves[1])[-5:]
    weights = (~np.isin(np.arange(len(halves[0])), fixed)).astype(float)
    pairs = cn.Mesh(*halves).topology.edges[-9:]
    for name, array in {"fixed": fixed, "mask": weights, "creases": pairs}.items():
        np.save("array.npy", array)
        in_file = denoised("halves.ply", weld=1e-4, **{name: "array.npy"})
        assert len(in_file) == len(halves[0]) - 5
        np.testing.assert_array_equal(denoised("halves.ply", weld=1e-4, **{name: array}), in_file)


def test_only_moves_what_lies_within_the_faces(ball):
    parts = (BALL.centroids[:, 2] > 0).astype(np.int32)
    for chosen in (parts == 1, np.flatnonzero(parts == 1)):
        out = expected(only=chosen)
        still = np.zeros(COUNT, bool)
        still[BALL.faces[parts == 0]] = True
        assert out[still].tobytes() == BALL.vertices[still].tobytes()
        assert (out[~still] != BALL.vertices[~still]).any(axis=1).all()
        np.testing.assert_array_equal(out, expected(mask=~still))


def test_face_properties_are_named_with_their_value(ball):
    for name, faces in (("part=1", PARTS == 1), ("part=0.0", PARTS == 0)):
        np.testing.assert_array_equal(labelled_faces([name], ball), faces)
    assert labelled_faces(["part=0", "part=1"], ball).all()
    np.testing.assert_array_equal(denoised(only=["part=0", "part=1"]), expected())
    np.testing.assert_array_equal(denoised(only="part=1"), expected(only=PARTS == 1))


OBJ = """\
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 2 0 0
v 2 1 0
f 1 2 3
o a thing
g left wheels
usemtl dark steel
f 1 3 4
g right  # a comment
usemtl b=2
f 2 5 6 3
g
f 1 2 6
o #1
g \\
  #a
usemtl Material #25
f 1 2 6
"""


@pytest.mark.parametrize(
    ("name", "triangles"),
    [
        ("a thing", [1, 2, 3, 4]),
        ("left", [1]),
        ("wheels", [1]),
        ("group=right", [2, 3]),
        ("dark steel", [1]),
        ("material=dark steel", [1]),
        ("b=2", [2, 3, 4]),
        ("material=b=2", [2, 3, 4]),
        ("#1", [5]),
        ("#a", [5]),
        ("Material #25", [5]),
    ],
)
def test_obj_faces_have_materials_objects_and_groups(tmp_path, name, triangles):
    (tmp_path / "things.obj").write_text(OBJ, encoding="ascii")
    file = cn.read(tmp_path / "things.obj")
    np.testing.assert_array_equal(np.flatnonzero(labelled_faces([name], file)), triangles)


def test_unknown_labels_are_answered_with_those_that_there_are(tmp_path, ball):
    (tmp_path / "things.obj").write_text(OBJ, encoding="ascii")
    there = (
        r"'wheel'; there are: material=dark steel, material=b=2, material=Material #25, object=a thing, object=#1, "
        r"group=left, group=right, group=#a, group=wheels"
    )
    with pytest.raises(cn.ParameterError, match=rf"only matches no face with {there}"):
        labelled_faces(["wheel"], cn.read(tmp_path / "things.obj"))
    with pytest.raises(cn.ParameterError, match="'part=7'; there are: part=0, part=1"):
        denoised(only="part=7")
    with pytest.raises(cn.ParameterError, match="'part=red'; there are"):
        denoised(only="part=red")
    with pytest.raises(
        cn.ParameterError, match=r"'group=up'; there are: group=left, group=right, group=#a, group=wheels$"
    ):
        labelled_faces(["group=up"], cn.read(tmp_path / "things.obj"))
    (tmp_path / "plain.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="ascii")
    with pytest.raises(cn.ParameterError, match="'x'; the file has no labels of faces"):
        labelled_faces(["x"], cn.read(tmp_path / "plain.obj"))


def test_gltf_faces_have_meshes_and_materials(tmp_path):
    box = cube(1).vertices.astype("<f4")
    indices = cube(1).faces.astype("<u2")
    data = box.tobytes() + indices.tobytes()
    views = [{"buffer": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 72}]
    accessors = [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"}]
    accessors += [
        {"bufferView": 1, "byteOffset": 36 * half, "componentType": 5123, "count": 18, "type": "SCALAR"}
        for half in range(2)
    ]
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
        "materials": [{"name": "brass"}, {}],
        "meshes": [
            {"name": "lid", "primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]},
            {"primitives": [{"attributes": {"POSITION": 0}, "indices": 2, "material": 1}]},
        ],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    (tmp_path / "box.glb").write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    file = cn.read(tmp_path / "box.glb")
    for name in ("lid", "brass", "mesh=lid", "material=brass"):
        np.testing.assert_array_equal(np.flatnonzero(labelled_faces([name], file)), np.arange(6))
    with pytest.raises(cn.ParameterError, match=r"there are: mesh=lid, material=brass$"):
        labelled_faces([""], file)


@pytest.mark.parametrize(
    ("controls", "message"),
    [
        (
            {"mask": "pain"},
            "mask is 'pain'; it must be a file .npy or .txt, or a vertex .* has: paint, quality, height",
        ),
        ({"mask": "height"}, r"weights that are not within 0 … 1 \(vertices"),
        ({"mask": "none.npy"}, r"mask is 'none.npy', a file that does not exist"),
        ({"mask": "words.txt"}, "mask is 'words.txt', which cannot be read as numbers: could not convert"),
        ({"mask": "short.txt"}, r"mask has shape \(3,\)"),
        ({"mask": "cube.npy"}, r"mask is 'cube.npy', which has shape \(2, 2, 2\); it must have 1 numbers in each row"),
        ({"fixed": "0,999"}, "fixed references vertex 999; the file has 162 vertices, counted from 0"),
        ({"fixed": "0-99999999999999"}, "fixed references vertex 99999999999999; the file has 162 vertices"),
        ({"fixed": "all"}, "fixed is 'all'; it must be vertex indices such as \"0,5,7-20\", a file .npy or .txt"),
        ({"fixed": "short.txt"}, "fixed references vertex 0.5; .* whole numbers"),
        ({"creases": "sharp"}, "creases is 'sharp'; it must be an angle in degrees, or a file .npy or .txt"),
        (
            {"creases": "short.txt"},
            r"creases is 'short.txt', which has shape \(3, 1\); it must have 2 numbers in each row",
        ),
        ({"creases": "-3"}, "creases is -3.0; an angle"),
        ({"only": [0.5]}, r"only has shape \(1,\) and type float64; it must be \(320,\) bool or indices of faces"),
        ({"only": [400]}, "only references face 400; there are 320 faces"),
        ({"only": [0, 1] * 160}, "only has a 0 or 1 for each of the 320 faces, but integers are indices of faces"),
        ({"fixed": np.ones(162, np.uint8)}, "fixed has a 0 or 1 for each of the 162 vertices.* convert a mask to bool"),
    ],
)
def test_what_does_not_fit_is_refused_with_a_reason(ball, tmp_path, controls, message):
    (tmp_path / "words.txt").write_text("0.5\nhalf\n", encoding="ascii")
    (tmp_path / "short.txt").write_text("0.5\n1\n0\n", encoding="ascii")
    np.save(tmp_path / "cube.npy", np.zeros((2, 2, 2)))
    with pytest.raises(cn.ParameterError, match=message):
        denoised(**controls)
    assert not (tmp_path / "out.ply").exists()


def two_painted_balls(kind: str) -> bytes:
    """Return a scene of two balls: the first in the file is red, but the scene shows the second one first."""
    paint = np.repeat(np.array([255, 0], np.uint8), COUNT)
    faces = Polygons.from_rows(np.concatenate([BALL.faces, BALL.faces + COUNT]).astype(np.int64))
    vertices = np.concatenate([BALL.vertices, BALL.vertices + np.array([5, 0, 0])])
    if kind == "dae":
        ball, halves = Polygons.from_rows(BALL.faces.astype(np.int64)), (slice(COUNT), slice(COUNT, None))
        contents = [Content(vertices[half], ball, dict.fromkeys(CHANNELS[:3], paint[half])) for half in halves]
        one = [b"".join(ColladaFile.encode(content)[0]) for content in contents]
        geometries = [re.search(rb"<geometry .*</geometry>", data, re.DOTALL)[0] for data in one]
        second = re.sub(rb'(id="|"#)', rb"\g<1>second-", geometries[1])
        shown = re.search(rb"<node.*</node>", one[0], re.DOTALL)[0]
        both = shown.replace(b'url="#', b'url="#second-') + shown
        return one[0].replace(geometries[0], geometries[0] + second).replace(shown, both)
    document, buffer, _ = document_of(Content(vertices, faces, dict.fromkeys(CHANNELS[:3], paint)))
    points, colors, corners = (document["accessors"][number] for number in (0, 1, 2))
    per_ball = [
        {**points, "count": COUNT, "byteOffset": 0},
        {**colors, "count": COUNT, "byteOffset": 0},
        {**corners, "count": BALL.faces.size},
        {**points, "count": COUNT, "byteOffset": 12 * COUNT},
        {**colors, "count": COUNT, "byteOffset": 4 * COUNT},
    ]
    attributes = [{"POSITION": 3 * mesh, "COLOR_0": 3 * mesh + 1} for mesh in (0, 1)]
    meshes = [{"primitives": [{"attributes": own, "indices": 2}]} for own in attributes]
    scene = {"nodes": [{"mesh": 1}, {"mesh": 0}], "scenes": [{"nodes": [0, 1]}]}
    return b"".join(GltfFile._made({**document, "accessors": per_ball, "meshes": meshes, **scene}, buffer))


@pytest.mark.parametrize("kind", ["gltf", "dae"])
def test_colours_belong_to_their_vertices_whatever_the_order_of_the_scene(tmp_path, kind):
    source, output = tmp_path / f"two.{kind}", tmp_path / f"out.{kind}"
    source.write_bytes(two_painted_balls(kind))
    before = cn.read(source)
    assert before.content().positions[0, 0] > 3  # the second ball is shown first
    assert before.vertex_values["red"].tolist() == [255] * COUNT + [0] * COUNT
    cn.denoise_file(source, output, mask="red", **FAST)
    moved = (cn.read(output).positions != before.positions).any(axis=1)
    assert moved[:COUNT].all() and not moved[COUNT:].any()
