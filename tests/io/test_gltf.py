"""glTF in its containers: JSON and buffers, in one file or in several."""

import json
import re
from base64 import b64decode, b64encode
from io import BytesIO

import numpy as np
import pytest
from gltfs import BALL, FAST, TEXT, TWO_MESHES, VEC3, beside_what_moves, changed, document, seen_by_trimesh, single
from sample_files import glb, gltf, read, written
from shapes import grid

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.io.content import Content
from cascadenorm.io.gltf.buffers import embedded
from cascadenorm.mesh.polygons import Polygons

# JSON


def test_values_beside_bounds_and_buffers_stay():
    file = read(gltf())
    moved = document(written(file.with_vertices(file.mesh.vertices + np.array((0, 0, 0.5)))))
    assert beside_what_moves(moved) == beside_what_moves(document(gltf()))
    assert moved["accessors"][4]["min"] == [0, 0, 0.5]
    assert written(file) == gltf()


def test_extras_of_any_kind_stay():
    extras = rb'"extras":{"name":"\xe9\u00e9\ud800","many":12345678901234567890,"small":1e-07,"nested":[[{}]]},'
    extras = extras.replace(rb"\xe9", b"\xe9")  # not UTF-8
    file = read(gltf().replace(b"{", b"{" + extras, 1))
    moved = document(written(file.with_vertices(file.mesh.vertices + 1)))
    expected = {"name": "\udce9é\ud800", "many": 12345678901234567890, "small": 1e-07, "nested": [[{}]]}
    assert moved["extras"] == expected


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("faces.bin", "lost.bin"), "'lost.bin', which does not exist beside this file"),
        (("faces.bin", "/etc/passwd"), "buffer 0 is at '/etc/passwd'"),
        (("faces.bin", "https://example.org/faces.bin"), "buffer 0 is at 'https:"),
        (('"uri": "faces.bin", ', ""), "buffer 0 of the glTF document has no data"),
        (("faces.bin", "data:application/octet-stream;base64,AA=A"), "invalid base64"),
        (("faces.bin", "data:text/plain,hello"), "embedded as 'data:text/plain', not in base64"),
        (("faces.bin", "maps"), "not exist beside"),
        (('"count": 960', '"count": 961'), "runs past the 1920 bytes of buffer 0"),
        (('"bufferView": 2, "comp', '"comp'), "accessor 2 of the glTF document has no data"),
        (('5123, "type": "SCALAR"', '5123, "type": "VEC2"'), "runs past|whole numbers"),
        (('"meshes"', '"meshes": 5, "meshes"'), None),
        (('"meshes": [', '"meshes": 5, "x": ['), "'meshes' in the glTF document is not a list"),
        (('"asset"', '"extensionsRequired": ["KHR_draco_mesh_compression"], "asset"'), "compressed"),
        (('"version" : "2.0"', '"version" : "1.0"'), "this glTF file has version 1.0; only version 2"),
        (('"version" : "2.0"', '"version": "3.0"'), "has version 3.0; only version 2 is supported"),
        (('"version" : "2.0"', '"version": "2.1", "minVersion": "2.1"'), "needs version 2.1; only version 2.0 is"),
        (('"asset"', '"extensionsUsed": ["EXT_meshopt_compression"], "asset"'), "compressed"),
    ],
)
def test_broken_documents_are_explained(place, change, words):
    assert change[0] in TEXT
    (place / "broken.gltf").write_text(TEXT.replace(*change), encoding="utf-8")
    if words is None:
        assert cn.read("broken.gltf").mesh is not None
        return
    with pytest.raises(io.ReadError, match=f"broken.gltf: .*({words})"):
        cn.read("broken.gltf")


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (("accessors", 0, "componentType"), "accessors[0] in the glTF document has no 'componentType'"),
        (("accessors", 2, "count"), "accessors[2] in the glTF document has no 'count'"),
        (("accessors", 1, "type"), "accessors[1] in the glTF document has no 'type'"),
        (("bufferViews", 1, "buffer"), "bufferViews[1] in the glTF document has no 'buffer'"),
        (("meshes", 0, "primitives"), "meshes[0] in the glTF document has no 'primitives'"),
        (
            ("meshes", 0, "primitives", 0, "attributes"),
            "meshes[0].primitives[0] in the glTF document has no 'attributes'",
        ),
        (("buffers", 1, "uri"), "buffer 1 of the glTF document has no data"),
    ],
)
def test_missing_keys_are_named_with_their_place(place, path, words):
    made = json.loads(TEXT)
    part = made
    for key in path[:-1]:
        part = part[key]
    del part[path[-1]]
    (place / "broken.gltf").write_text(json.dumps(made), encoding="utf-8")
    with pytest.raises(io.ReadError, match=re.escape(words)):
        cn.read("broken.gltf")


def test_lengths_of_buffers_are_not_needed(place):
    made = json.loads(TEXT)
    for part in (*made["bufferViews"], *made["buffers"]):
        del part["byteLength"]
    (place / "plain.gltf").write_text(json.dumps(made), encoding="utf-8")
    assert np.array_equal(cn.read("plain.gltf").positions, BALL.vertices.astype("<f4"))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (
            ("accessors", 0, "componentType"),
            5124,
            "accessors[0] in the glTF document has the unknown componentType 5124",
        ),
        (("accessors", 0, "componentType"), [5126], "unknown componentType [5126]"),
        (("accessors", 2, "type"), "VEC5", "accessors[2] in the glTF document has the unknown type 'VEC5'"),
        (("accessors", 0, "bufferView"), 9, "refers to bufferViews[9], which does not exist"),
        (("accessors", 0, "bufferView"), -1, "refers to bufferViews[-1], which does not exist"),
        (("bufferViews", 0, "buffer"), "x", "buffer 'x' of the glTF document has no data"),
        (("meshes", 0, "primitives", 0, "indices"), 7, "refers to accessors[7], which does not exist"),
        (("meshes", 0, "primitives", 0, "attributes"), 7, "wrong type"),
        (("accessors", 0, "sparse"), {"count": 1, "indices": {}}, "accessors[0].sparse in the glTF document has no"),
        (
            ("accessors", 0, "sparse"),
            {"count": 1, "indices": {"bufferView": 0}, "values": {"bufferView": 0}},
            "accessors[0].sparse.indices in the glTF document has no 'componentType'",
        ),
    ],
)
def test_wrong_values_are_named_with_their_place(place, path, value, words):
    made = json.loads(TEXT)
    part = made
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    (place / "broken.gltf").write_text(json.dumps(made), encoding="utf-8")
    with pytest.raises(io.ReadError, match=re.escape(words)):
        cn.read("broken.gltf")


@pytest.mark.parametrize("kind", [("<u1", 5121), ("<u2", 5123), ("<u4", 5125)])
@pytest.mark.parametrize("based", [True, False])
def test_sparse_positions_are_read_and_written_where_they_lie(kind, based):
    points = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 1)], "<f4")
    rows = np.array([1, 3] if based else [0, 1, 2, 3], kind[0])
    base = np.where(np.isin(np.arange(4), rows)[:, None], np.float32(7), points)
    sparse = {
        "count": len(rows),
        "indices": {"bufferView": 1, "componentType": kind[1]},
        "values": {"bufferView": 2},
    }
    accessor = {"count": 4, **VEC3, "sparse": sparse, **({"bufferView": 0} if based else {})}
    views = [base.tobytes(), rows.tobytes(), points[rows].tobytes()]
    data = single([accessor], views, {"attributes": {"POSITION": 0}, "mode": 5})
    file = read(data)
    corners = file.mesh.corners
    assert np.array_equal(corners[0], points[[0, 1, 2]])
    assert {tuple(v) for v in corners[1]} == {tuple(v) for v in points[1:]}
    moved = document(written(file.with_vertices(file.mesh.vertices + 1)))
    parts = [b64decode(buffer["uri"].partition(",")[2]) for buffer in moved["buffers"]]
    unused = np.frombuffer(parts[0], "<f4").reshape(-1, 3)[rows] if based else np.full((1, 3), 7)
    assert (unused == 7).all()  # rows of the base that are replaced
    assert parts[1] == views[1]
    assert np.array_equal(np.frombuffer(parts[2], "<f4").reshape(-1, 3), points[rows] + 1)


@pytest.mark.parametrize(
    ("sparse", "words"),
    [
        ({"count": 1, "indices": {"bufferView": 1, "componentType": 5121}, "values": {"bufferView": 2}}, "no data"),
        ({"count": 4, "indices": {"bufferView": 1, "componentType": 5121}, "values": {"bufferView": 2}}, "9 of 4"),
    ],
)
def test_sparse_accessors_with_gaps_are_refused(sparse, words):
    views = [b"", bytes([0, 1, 2, 9]), bytes(48)]
    data = single([{"count": 4, **VEC3, "sparse": sparse}], views, {"attributes": {"POSITION": 0}})
    with pytest.raises(io.ReadError, match=words):
        read(data)


def test_a_count_without_content_allocates_nothing():
    with pytest.raises(io.ReadError, match="no data"):
        read(single([{"count": 10**12, **VEC3}], [b""], {"attributes": {"POSITION": 0}}))


def test_fans_share_their_first_corner():
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], "<f4")
    data = single(
        [{"bufferView": 0, "count": 4, **VEC3}], [points.tobytes()], {"attributes": {"POSITION": 0}, "mode": 6}
    )
    assert read(data).mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    empty = single([{"bufferView": 0, "count": 0, **VEC3}], [b""], {"attributes": {"POSITION": 0}, "mode": 6})
    assert len(read(empty).polygons) == 0


# containers, and other formats


def test_containers_change_without_loss(place):
    assert run(["denoise", "ball.gltf", *FAST, "-o", "ball.glb"]) == 0
    assert run(["denoise", "ball.glb", *FAST, "-o", "back.gltf", "--strength", "0"]) == 0
    assert run(["denoise", "ball.gltf", *FAST]) == 0
    expected = document((place / "ball_denoised.gltf").read_bytes())
    for name in "ball.glb", "back.gltf":
        found = document((place / name).read_bytes())
        assert [set(b) - {"uri"} for b in found.pop("buffers")] == [{"byteLength"}] * 2
        assert found == {key: value for key, value in expected.items() if key != "buffers"}
        assert np.array_equal(cn.read(name).positions, cn.read("ball_denoised.gltf").positions)
        assert np.array_equal(seen_by_trimesh(name), seen_by_trimesh("ball_denoised.gltf"))


def test_glb_with_buffers_in_files_is_read_and_written(place):
    text = TEXT.encode() + b" " * (-len(TEXT.encode()) % 4)
    head = b"glTF" + (2).to_bytes(4, "little") + (20 + len(text)).to_bytes(4, "little")
    (place / "b.glb").write_bytes(head + len(text).to_bytes(4, "little") + b"JSON" + text)
    assert run(["denoise", "b.glb", *FAST]) == 0
    assert run(["denoise", "ball.gltf", *FAST]) == 0
    assert (place / "b_denoised.bin").read_bytes() == (place / "ball_denoised.bin").read_bytes()


@pytest.mark.parametrize("format", ["glb", "gltf"])
def test_made_files_hold_colours_and_texture(format, tmp_path):
    mesh = grid(3, 2)
    count = len(mesh.vertices)
    rng = np.random.default_rng(0)
    colors = {n: rng.integers(0, 256, count).astype(np.uint8) for n in ("red", "green", "blue", "alpha")}
    texture = {n: rng.integers(0, 9, count).astype(np.float32) / 8 for n in "st"}
    content = Content(
        mesh.vertices.astype(np.float32), Polygons.from_rows(mesh.faces.astype(np.int64)), {**colors, **texture}
    )
    pieces, lost = io.files.FORMATS[format].encode(content)
    data = b"".join(pieces)
    again = read(data).content()
    assert lost == []
    assert np.array_equal(again.positions, content.positions)
    assert np.array_equal(again.polygons.corners, content.polygons.corners)
    assert again.vertex_values.keys() == content.vertex_values.keys()
    assert all(np.array_equal(again.vertex_values[n], v) for n, v in content.vertex_values.items())
    (tmp_path / f"a.{format}").write_bytes(data)
    assert np.array_equal(seen_by_trimesh(tmp_path / f"a.{format}"), mesh.vertices)


def test_content_can_be_read_any_number_of_times(monkeypatch):
    monkeypatch.setattr("cascadenorm.io.limits.ALWAYS", 1.0)
    monkeypatch.setenv("CASCADENORM_MAX_EXPANSION", "2")
    file = read(glb())
    for _ in range(20):
        assert len(file.content().positions) > 0
        assert file.vertex_values == {}


def test_scenes_convert_with_transforms_and_mirrors():
    text = document(glb())
    half = 0.5**0.5
    text["nodes"] = [
        {"children": [1, 0], "translation": [1, 0, 0]},  # names itself: passed over
        {"mesh": 0, "rotation": [0, 0, half, half], "scale": [2, 1, 1]},
        {"mesh": 0, "matrix": [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 3, 1]},
    ]
    text["scenes"] = [{"nodes": [0, 2]}]
    size = int.from_bytes(glb()[12:16], "little")
    text["buffers"][0]["uri"] = "data:;base64," + b64encode(glb()[28 + size : 28 + size + 252]).decode()
    content = read(json.dumps(text).encode()).content()
    quad = [(0, 0), (1, 0), (0, 1), (1, 0), (0, 1), (1, 1)]
    assert np.allclose(content.positions[:6], [(1 - y, 2 * x, 0) for x, y in quad], atol=1e-7)
    assert np.allclose(content.positions[6:], [(-x, y, 3) for x, y in quad])
    triangles = content.positions[content.polygons.corners.reshape(-1, 3)]
    assert (np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[:, 2] > 0).all()


@pytest.mark.parametrize("scale", ["NaN", "1e308", "-Infinity"])
def test_transforms_that_are_not_finite_are_refused(scale):
    file = read(gltf().replace(b'"scale": [\n    2,', f'"scale": [{scale},'.encode()))
    assert written(file.with_vertices(file.mesh.vertices + 1))
    with pytest.raises(io.ReadError, match="transform of node 0 is not finite"):
        file.content()


def test_morphs_skins_and_animations_stay(tmp_path):
    """Buffers of anything else than vertices are not even looked for."""
    text = json.loads(
        TEXT.replace("faces.bin", "data:;base64," + b64encode(BALL.faces.astype("<u2").tobytes()).decode())
    )
    points = np.concatenate([BALL.vertices] * 2).astype("<f4").tobytes()
    text["buffers"][1]["uri"] = "data:;base64," + b64encode(points).decode()
    text["buffers"].append({"uri": "animation.bin", "byteLength": 12})
    text["bufferViews"].append({"buffer": 2, "byteLength": 12})
    text["accessors"].append({"bufferView": 3, "count": 1, **VEC3, "min": [0, 0, 0], "max": [1, 1, 1]})
    text["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 3}]
    text["animations"] = [{"samplers": [{"input": 3, "output": 3}], "channels": []}]
    (tmp_path / "a.gltf").write_text(json.dumps(text))
    assert run(["denoise", str(tmp_path / "a.gltf"), *FAST]) == 0
    found = json.loads((tmp_path / "a_denoised.gltf").read_text())
    assert found["buffers"][2] == text["buffers"][2]
    assert found["accessors"][3] == text["accessors"][3]
    assert found["meshes"] == text["meshes"] and found["animations"] == text["animations"]


def test_a_scene_with_nodes_that_do_not_exist_is_explained_where_triangles_are_removed():
    file = changed(lambda found: found["scenes"][0].update(nodes=[99]))
    with pytest.raises(io.ReadError, match="not valid glTF 2: a number refers to an entry that does not exist"):
        file.without(np.zeros(len(file.polygons), bool))


def test_primitives_over_the_same_vertices_share_them_in_other_formats():
    def twice(found: dict) -> None:
        found["meshes"][0]["primitives"].append(found["meshes"][0]["primitives"][0] | {"material": 1})

    alone, both = read(gltf()).content(), changed(twice).content()
    np.testing.assert_array_equal(both.positions, alone.positions)
    assert len(both.polygons.counts) == len(alone.polygons.counts) + 2


def test_meshes_that_the_scene_does_not_show_are_named_and_all_are_there_if_it_shows_none():
    def without_strip(found: dict) -> None:
        found["scenes"][0]["nodes"] = [0]

    def without_meshes(found: dict) -> None:
        found["nodes"] = [{"name": "empty"}]
        found["scenes"][0]["nodes"] = [0]

    named = "meshes that the scene does not show"
    assert named not in read(gltf()).content().left_out
    part, whole = changed(without_strip).content(), changed(without_meshes).content()
    assert named in part.left_out and len(part.positions) == 6
    assert named not in whole.left_out and len(whole.positions) == 10


def test_morph_targets_and_instances_are_named_where_other_formats_lose_them():
    def more(found: dict) -> None:
        primitive = found["meshes"][0]["primitives"][0]
        primitive["targets"] = [{"POSITION": primitive["attributes"]["POSITION"]}]
        found["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {}}}

    named = ["morph targets", "instances of meshes (EXT_mesh_gpu_instancing)"]
    assert set(changed(more).content().left_out) - set(read(gltf()).content().left_out) == {*named}


@pytest.mark.parametrize("offset", [0, 2, 1942])
@pytest.mark.parametrize("where", ["indices", "TEXCOORD_0", "targets"])
def test_bytes_of_positions_that_are_others_as_well_are_refused(offset, where):
    """Else the denoised positions would overwrite the indices, or what else lies there."""
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    other = {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 3}
    if where == "indices":
        primitive["indices"] = 2
    elif where == "targets":
        primitive["targets"] = [{"POSITION": 2}]
    else:
        primitive["attributes"][where] = 2
    made = {
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [primitive]}],
        "accessors": [
            {"bufferView": 0, **VEC3, "count": 162},
            {"bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": 960},
            other,
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 1944},
            {"buffer": 0, "byteOffset": offset, "byteLength": 1944},
            {"buffer": 0, "byteOffset": 1944, "byteLength": 1920},
        ],
    }
    buffer = np.zeros(162 * 3, "<f4").tobytes() + BALL.faces.astype("<u2").tobytes()
    made["buffers"] = [{"byteLength": len(buffer), "uri": embedded(buffer)}]
    with pytest.raises(io.ReadError, match="accessor 2 of this glTF file overlaps with positions"):
        io.read(BytesIO(json.dumps(made).encode()))
    made["bufferViews"][1]["byteOffset"] = 1944
    assert len(io.read(BytesIO(json.dumps(made).encode())).polygons) in (1, 320)


def test_what_is_interleaved_does_not_overlap():
    rows = np.zeros(162, [("position", "<f4", 3), ("texture", "<f4", 2)])
    rows["position"] = BALL.vertices
    buffer = rows.tobytes() + BALL.faces.astype("<u2").tobytes()
    view = {"buffer": 0, "byteLength": rows.nbytes, "byteStride": rows.itemsize}
    made = {
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}]}],
        "accessors": [
            {"bufferView": 0, **VEC3, "count": 162},
            {"bufferView": 0, "byteOffset": 12, "componentType": 5126, "type": "VEC2", "count": 162},
            {"bufferView": 1, "componentType": 5123, "type": "SCALAR", "count": 960},
        ],
        "bufferViews": [view, {"buffer": 0, "byteOffset": rows.nbytes, "byteLength": 1920}],
        "buffers": [{"byteLength": len(buffer), "uri": embedded(buffer)}],
    }
    assert np.array_equal(io.read(BytesIO(json.dumps(made).encode())).positions, BALL.vertices.astype("<f4"))
    made["accessors"][1]["byteOffset"] = 8
    with pytest.raises(io.ReadError, match="overlaps"):
        io.read(BytesIO(json.dumps(made).encode()))


@pytest.mark.parametrize(
    "change",
    [
        {"images": {"a": 1}},
        {"images": [1]},
        {"images": [{"uri": 5}]},
        {"extensionsUsed": 5},
        {"buffers": [*TWO_MESHES["buffers"], {"uri": [1]}]},
        {"nodes": "x"},
        {"materials": [None]},
    ],
)
def test_parts_of_a_document_of_the_wrong_type_are_refused(two_meshes, change, capsys):
    (two_meshes / "in.gltf").write_text(json.dumps({**TWO_MESHES, **change}))
    assert run(["denoise", "in.gltf", *FAST, "-o", "elsewhere/out.ply"]) == 3
    assert "glTF document" in capsys.readouterr().err
