"""glTF in its containers: what moves is written beside what stays, in one file or in several."""

import json
import os
import re
import sys
from base64 import b64encode
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
from gltfs import (
    BALL,
    FAST,
    TEXT,
    TWO_MESHES,
    VEC3,
    beside_what_moves,
    changed,
    document,
    quantized,
    seen_by_trimesh,
    single,
)
from sample_files import glb, gltf, read, written

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.io.gltf.buffers import embedded
from cascadenorm.io.gltf.gltf import GlbFile


def test_values_beside_bounds_and_buffers_stay():
    file = read(gltf())
    moved = document(written(file.with_vertices(file.mesh.vertices + np.array((0, 0, 0.5)))))
    assert beside_what_moves(moved) == beside_what_moves(document(gltf()))
    assert moved["accessors"][4]["min"] == [0, 0, 0.5]
    assert written(file) == gltf()


def chunks(data: bytes) -> dict[bytes, bytes]:
    found, at = {}, 12
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "little")
        found[data[at + 4 : at + 8]] = data[at + 8 : at + 8 + size]
        at += 8 + size
    return found


def test_glb_keeps_all_but_positions_normals_and_their_bounds():
    file = read(glb())
    moved = written(file.with_vertices(file.mesh.vertices * (1, 2, 3) + (0, 0, 0.5)))
    before, after = chunks(glb()), chunks(moved)
    old, new = json.loads(before[b"JSON"]), json.loads(after[b"JSON"])
    assert new["accessors"][0]["max"] == [1, 2, 0.5]
    assert new["accessors"][4]["min"] == [0, 0, 0.5]
    for described in (old, new):
        for accessor in described["accessors"]:
            accessor.pop("min", None)
            accessor.pop("max", None)
    assert old == new
    assert after[b"EXTR"] == before[b"EXTR"]
    assert after[b"BIN\0"][144:204] == before[b"BIN\0"][144:204]
    assert int.from_bytes(moved[8:12], "little") == len(moved)


def test_glb_closes_seams_and_keeps_meshes_apart():
    file = read(glb())
    assert file.welds.tolist() == [0, 1, 2, 1, 2, 3, 4, 5, 6, 7]
    assert np.allclose(file.mesh.face_normals[:, 2], (1, 1, -1, -1))
    assert file.parts.tolist() == [0] * 6 + [1] * 4


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((b'"count": 4', b'"count": 9'), "past the 252 bytes"),
        ((b'"byteOffset": 12', b'"byteOffset": 8 '), "overlap"),
        ((b'"POSITION": 4', b'"POSITION": 8'), r"refers to accessors\[8\], which does not exist"),
        ((b'"type": "VEC3"', b'"type": "VEC4"'), "is not VEC3"),
        ((b'"scene": 0,', b'"scene" 0, '), "not valid glTF"),
        ((b'{"POSITION": 4}', b'["position", 4]'), "an entry has the wrong type or size: export"),
        ((b"glTF\2", b"glTF\1"), "version 1"),
    ],
)
def test_damaged_glb_is_explained(change, words):
    with pytest.raises(io.ReadError, match=words):
        read(glb().replace(*change), "glb")


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


def test_fans_share_their_first_corner():
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], "<f4")
    data = single(
        [{"bufferView": 0, "count": 4, **VEC3}], [points.tobytes()], {"attributes": {"POSITION": 0}, "mode": 6}
    )
    assert read(data).mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    empty = single([{"bufferView": 0, "count": 0, **VEC3}], [b""], {"attributes": {"POSITION": 0}, "mode": 6})
    assert len(read(empty).polygons) == 0


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


def test_what_whole_numbers_lose_is_said_and_elsewhere_the_scene_has_its_size(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.glb").write_bytes(quantized())
    assert run(["denoise", "ball.glb", *FAST]) == 0
    assert "left out: precision beyond that of the integers that store the positions" in capsys.readouterr().err
    assert run(["denoise", "ball.glb", *FAST, "-o", "ball.ply", "--strength", "0"]) == 0
    expected = 2.0 * cn.read("ball.glb").positions + np.array([1, 2, 3])
    np.testing.assert_allclose(cn.read("ball.ply").positions, expected)
    assert run(["denoise", "ball.glb", *FAST, "--strength", "0", "-o", "same.glb"]) == 0
    assert (tmp_path / "same.glb").read_bytes() == quantized() and "whole" not in capsys.readouterr().err


def test_several_types_of_positions_in_a_mesh_are_refused():
    described = document(quantized())
    first = described["meshes"][0]["primitives"]
    described["accessors"].append({**described["accessors"][0], "componentType": 5122, "bufferView": 3})
    size = described["buffers"][0]["byteLength"]
    described["bufferViews"].append({**described["bufferViews"][0], "byteOffset": size})
    first.append({**first[0], "attributes": {"POSITION": 3}})
    chunk = quantized()[-size:]
    described["buffers"][0]["byteLength"] = 2 * size
    with pytest.raises(cn.ReadError, match="in several component types"):
        read(b"".join(GlbFile._made(described, chunk + chunk)))


def names(folder) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_buffers_that_move_get_a_file_beside_the_output(place):
    before = {name: (place / name).read_bytes() for name in names(place)}
    assert run(["denoise", "ball.gltf", *FAST]) == 0
    assert names(place) == sorted([*before, "ball_denoised.gltf", "ball_denoised.bin"])
    assert all((place / name).read_bytes() == content for name, content in before.items())
    text = (place / "ball_denoised.gltf").read_text(encoding="utf-8")
    assert beside_what_moves(json.loads(text)) == beside_what_moves(json.loads(TEXT))
    assert [b["uri"] for b in json.loads(text)["buffers"]] == ["faces.bin", "ball_denoised.bin"]
    vertices = cn.denoise(BALL.moved(BALL.vertices.astype(np.float32)), method="laplacian").vertices
    assert np.array_equal(cn.read("ball_denoised.gltf").mesh.vertices, vertices.astype(np.float32))
    assert np.array_equal(seen_by_trimesh("ball_denoised.gltf"), vertices.astype(np.float32))


def test_unmoved_files_stay_as_they_are(place):
    assert run(["denoise", "ball.gltf", *FAST, "--strength", "0", "-o", "same.gltf"]) == 0
    assert (place / "same.gltf").read_bytes() == (place / "ball.gltf").read_bytes()
    assert not (place / "same.bin").exists()


@pytest.mark.parametrize("strength", ["0", "1"])
def test_another_folder_gets_all_that_is_needed(place, strength):
    (place / "out").mkdir()
    assert run(["denoise", "ball.gltf", *FAST, "-o", "out/b\u00e4ll 1.gltf", "--strength", strength]) == 0
    buffers = ["b\u00e4ll 1.bin"] if strength == "1" else ["the points.bin"]
    assert names(place / "out") == sorted(["b\u00e4ll 1.gltf", *buffers, "faces.bin", "maps/a colour.png"])
    for name in names(place):
        if name != "ball.gltf":
            (place / name).unlink() if not name.startswith("out/") else None
    assert len(cn.read("out/b\u00e4ll 1.gltf").mesh.faces) == 320


def test_what_lies_in_the_way_is_found_before_anything_is_computed(place, capsys, monkeypatch):
    monkeypatch.setattr("cascadenorm.api.api.run_with_controls", None)
    (place / "ball_denoised.bin").write_bytes(b"precious")
    (place / "out").mkdir()
    (place / "out" / "faces.bin").write_bytes(b"precious")
    before = names(place)
    for output in "ball_denoised.gltf", "out/ball.gltf":
        assert run(["denoise", "ball.gltf", *FAST, "-o", output]) == 5
        message = capsys.readouterr().err
        assert re.search(r"ball_denoised\.bin exists already|faces\.bin exists already", message)
    assert names(place) == before
    assert (place / "ball_denoised.bin").read_bytes() == (place / "out" / "faces.bin").read_bytes() == b"precious"


def test_equal_copies_are_in_nobodys_way(place):
    (place / "out").mkdir()
    (place / "out" / "faces.bin").write_bytes((place / "faces.bin").read_bytes())
    assert run(["denoise", "ball.gltf", *FAST, "-o", "out/a.gltf"]) == 0
    assert run(["denoise", "ball.gltf", *FAST, "-o", "out/b.gltf"]) == 0
    assert run(["denoise", "ball.gltf", *FAST, "-o", "out/b.gltf", "--force"]) == 0


def test_failing_write_takes_the_buffer_back(place, monkeypatch):
    monkeypatch.setattr(
        "os.link",
        lambda name, target: (
            (_ for _ in ()).throw(FileExistsError())
            if str(target).endswith("gltf")
            else (place / "ball_denoised.bin").write_bytes(b"new")
        ),
    )
    before = names(place)
    assert run(["denoise", "ball.gltf", *FAST]) == 5
    assert names(place) == before


@pytest.mark.parametrize("renames", range(6))
def test_a_document_never_names_the_buffer_of_another_one(place, monkeypatch, renames):
    """Whenever the work ends between two renames, the document and the buffer that it names belong together."""
    assert run(["denoise", "ball.gltf", *FAST]) == 0
    old, new = (cn.read(name).positions for name in ("ball_denoised.gltf", "ball.gltf"))
    new = cn.denoise(new, cn.read("ball.gltf").mesh.faces, method="laplacian", strength=2)
    before, done, replace = names(place), [], os.replace

    def some(name, target):
        if len(done) == renames:
            raise KeyboardInterrupt
        done.append(target)
        replace(name, target)

    monkeypatch.setattr("os.replace", some)
    code = run(["denoise", "ball.gltf", *FAST, "--strength", "2", "--force"])
    monkeypatch.undo()
    monkeypatch.chdir(place)
    found = cn.read("ball_denoised.gltf").positions
    assert code == (130 if renames < 4 else 0)
    assert found.tobytes() == (old if renames < 2 else new).tobytes()
    bounds = [a for a in document((place / "ball_denoised.gltf").read_bytes())["accessors"] if a["type"] == "VEC3"]
    assert any(np.array_equal(a["min"], found.min(axis=0)) for a in bounds)
    extra = [name for name in names(place) if name not in before]
    assert extra == [] if code == 0 else all(name.startswith(".ball_denoised.bin.") for name in extra)
    if code == 0:
        assert "ball_denoised.bin" in [
            b["uri"] for b in json.loads((place / "ball_denoised.gltf").read_text())["buffers"]
        ]


def test_missing_pictures_are_named_and_names_that_lead_out_refused(place, capsys):
    (place / "out").mkdir()
    (place / "maps" / "a colour.png").unlink()
    assert run(["denoise", "ball.gltf", *FAST, "-o", "out/ball.gltf", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["left_out"] == ["the file 'maps/a colour.png' that it references"]
    (place / "in").mkdir()
    (place / "in" / "up.gltf").write_text(TEXT.replace("faces.bin", "../faces.bin").replace("the%20", "../the%20"))
    assert run(["denoise", "in/up.gltf", *FAST]) == 3
    assert "buffer 0 is '../faces.bin', outside the folder of this file" in capsys.readouterr().err


def test_streams_hold_everything_or_are_refused(place, capsys, monkeypatch):
    with monkeypatch.context() as patched, open("out.gltf", "wb") as out:
        patched.setattr(sys, "stdout", SimpleNamespace(buffer=out, flush=lambda: None))
        assert run(["denoise", "ball.gltf", *FAST, "-o", "-"]) == 0
    assert run(["denoise", "ball.gltf", *FAST]) == 0
    assert np.array_equal(cn.read("out.gltf").positions, cn.read("ball_denoised.gltf").positions)
    assert document((place / "out.gltf").read_bytes())["buffers"][1]["uri"].startswith("data:")
    with open("ball.gltf", "rb") as stream, pytest.raises(io.ReadError, match="cannot be found from a stream"):
        io.read(stream)


@pytest.mark.parametrize("folder", ["", "elsewhere/"])
def test_every_buffer_that_the_output_names_is_written(two_meshes, folder):
    """Also those of meshes that stay where they are, and under names that no other buffer has."""
    source = cn.read("in.gltf")
    (two_meshes / folder / "q.bin").write_bytes((two_meshes / "q.bin").read_bytes())
    assert run(["denoise", "in.gltf", *FAST, "--only", "mesh=a", "-o", f"{folder}out.gltf"]) == 0
    moved = cn.read(f"{folder}out.gltf")
    count = len(BALL.vertices)
    assert np.array_equal(moved.mesh.faces, source.mesh.faces)
    assert np.array_equal(moved.positions[count:], source.positions[count:])
    assert (moved.positions[:count] != source.positions[:count]).any()
    uris = [buffer["uri"] for buffer in document((two_meshes / f"{folder}out.gltf").read_bytes())["buffers"]]
    assert uris == ["out_0.bin", "out_1.bin", "out.bin"]
    assert (two_meshes / folder / "out.bin").read_bytes() == BALL.faces.astype("<u2").tobytes()


def test_a_buffer_that_is_needed_and_missing_is_not_left_out(two_meshes, capsys):
    text = json.dumps({**TWO_MESHES, "buffers": [*TWO_MESHES["buffers"], {"uri": "animation.bin", "byteLength": 4}]})
    (two_meshes / "in.gltf").write_text(text)
    assert run(["denoise", "in.gltf", *FAST, "-o", "elsewhere/out.gltf"]) == 5
    assert "'animation.bin', which is missing" in capsys.readouterr().err
    assert names(two_meshes / "elsewhere") == []


@pytest.mark.parametrize("uri", [".", "a" * 3000, "a\0b.png", "../p.png", "p.png/q.png"])
def test_images_that_cannot_be_are_named(two_meshes, uri, capsys):
    (two_meshes / "in.gltf").write_text(json.dumps({**TWO_MESHES, "images": [{"uri": uri}]}))
    assert run(["denoise", "in.gltf", *FAST, "-o", "elsewhere/out.gltf", "--json"]) == 0
    (left_out,) = json.loads(capsys.readouterr().out)["left_out"]
    assert left_out.startswith("the file '") and len(left_out) < 130
