"""The JSON of a glTF document keeps what it holds, and its scene converts to one mesh and back."""

import json
from base64 import b64encode

import numpy as np
import pytest
from gltfs import COARSE, FAST, TWO_MESHES, changed, document, seen_by_trimesh, with_attribute
from sample_files import glb, gltf, read, written
from shapes import grid

from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.io.content import Content
from cascadenorm.mesh.polygons import Polygons


def test_extras_of_any_kind_stay():
    extras = rb'"extras":{"name":"\xe9\u00e9\ud800","many":12345678901234567890,"small":1e-07,"nested":[[{}]]},'
    extras = extras.replace(rb"\xe9", b"\xe9")  # not UTF-8
    file = read(gltf().replace(b"{", b"{" + extras, 1))
    moved = document(written(file.with_vertices(file.mesh.vertices + 1)))
    expected = {"name": "\udce9é\ud800", "many": 12345678901234567890, "small": 1e-07, "nested": [[{}]]}
    assert moved["extras"] == expected


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


def test_glb_converts_with_its_transforms():
    content = read(glb()).content()
    assert content.positions.max(axis=0) == pytest.approx([6, 2, 0.1])
    assert len(content.polygons) == 6


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


def test_attributes_that_other_formats_cannot_hold_are_named(tmp_path, capsys):
    whole = np.ones((len(COARSE.vertices), 2), np.uint16)
    source = tmp_path / "ball.glb"
    for name, values, kind in (("TEXCOORD_0", whole, "VEC2"), ("TANGENT", np.ones((len(whole), 4), "<f4"), "VEC4")):
        source.write_bytes(with_attribute(name, values, type=kind))
        assert run(["denoise", str(source), *FAST, "-o", str(tmp_path / "ball.ply"), "--force"]) == 0
        assert f"left out: the attribute {name} of vertices" in capsys.readouterr().err
