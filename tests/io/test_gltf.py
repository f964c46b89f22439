"""glTF in its containers: JSON and buffers, in one file or in several."""

import json
import os
import re
import sys
from base64 import b64decode, b64encode
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
from shapes import grid, icosphere, noisy
from test_io import glb, gltf, read, written

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.io.content import Content
from cascadenorm.io.gltf.buffers import embedded
from cascadenorm.io.gltf.glb import GlbFile
from cascadenorm.mesh.polygons import Polygons

FAST = ["--method", "laplacian"]
BALL = noisy(icosphere(2), 0.2)
VEC3 = {"componentType": 5126, "type": "VEC3"}
TEXT = """{ "asset":{"version" : "2.0"}, "extras":{"x":1e-07,"name":"caf\u00e9 \\u00e9 \\/"},
  "images":[{"uri":"maps/a%20colour.png"},{"uri":"data:image/png;base64,AAAA"}],
  "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]}],
  "accessors": [
    {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 162, "max": [ 9, 9, 9.0 ], "min": [-9,-9,-9]},
    {"bufferView": 1, "componentType": 5126, "type": "VEC3", "count": 162},
    {"bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": 960, "max": [161]} ],
  "bufferViews": [{"buffer": 1, "byteLength": 1944}, {"buffer": 1, "byteOffset": 1944, "byteLength": 1944},
                  {"buffer": 0, "byteLength": 1920}],
  "buffers": [{"uri": "faces.bin", "byteLength": 1920}, {"byteLength": 3888, "uri": "the%20points.bin"}] }
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a glTF file in four parts."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.gltf").write_text(TEXT, encoding="utf-8")
    (tmp_path / "faces.bin").write_bytes(BALL.faces.astype("<u2").tobytes())
    points = np.concatenate([BALL.vertices, BALL.vertices]).astype("<f4")
    (tmp_path / "the points.bin").write_bytes(points.tobytes())
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "a colour.png").write_bytes(b"picture")
    return tmp_path


def names(folder) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def document(data: bytes) -> dict:
    """Return the JSON of either container."""
    start = 20 if data[:4] == b"glTF" else 0
    return json.loads(data[start : start + int.from_bytes(data[12:16], "little")] if start else data)


def seen_by_trimesh(path) -> np.ndarray:
    """Return the positions as another reader finds them."""
    import trimesh

    return np.concatenate([mesh.vertices for mesh in trimesh.load_scene(path, process=False).geometry.values()])


def beside_what_moves(document: dict) -> dict:
    """Return a document without bounds of accessors and names of buffers."""
    accessors = [{k: v for k, v in part.items() if k not in ("min", "max")} for part in document["accessors"]]
    buffers = [{k: v for k, v in part.items() if k != "uri"} for part in document["buffers"]]
    return document | {"accessors": accessors, "buffers": buffers}


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


# several files


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
    monkeypatch.setattr("cascadenorm.api.api.controlled", None)
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


# accessors


def single(accessors: list, views: list[bytes], primitive: dict) -> bytes:
    """Return a document of one primitive, each view in a buffer of its own."""
    buffers = [{"byteLength": len(v), "uri": "data:;base64," + b64encode(v).decode()} for v in views]
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "meshes": [{"primitives": [primitive]}],
            "accessors": accessors,
            "bufferViews": [{"buffer": i, "byteLength": len(v)} for i, v in enumerate(views)],
            "buffers": buffers,
        }
    ).encode()


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


# positions in whole numbers (KHR_mesh_quantization)

COARSE = noisy(icosphere(3), 0.3)


def quantized(kind: str = "<u2", *, normalized: bool = False) -> bytes:
    """A GLB file whose positions are whole numbers and whose normals are bytes; a node scales it back."""
    largest = np.iinfo(kind).max
    lower = np.zeros(3) if kind[1] == "u" else np.full(3, -largest)
    size = np.ptp(COARSE.vertices, axis=0).max()
    whole = np.rint((COARSE.vertices - COARSE.vertices.min(axis=0)) / size * (largest - lower) + lower).astype(kind)
    cells = np.zeros((len(whole), -(-3 * whole.itemsize // 4) * 4), np.uint8)
    cells[:, : 3 * whole.itemsize] = whole.view(np.uint8).reshape(len(whole), -1)
    normals = np.zeros((len(whole), 4), np.int8)
    normals[:, :3] = np.rint(COARSE.vertex_normals * 127)
    faces = COARSE.faces.astype("<u2")
    parts = [cells.tobytes(), normals.tobytes(), faces.tobytes()]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    strides = [cells.shape[1], 4, None]
    code = {"<u2": 5123, "<i2": 5122, "<u1": 5121, "<i1": 5120}[kind]
    described = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_mesh_quantization"],
        "extensionsRequired": ["KHR_mesh_quantization"],
        "nodes": [{"mesh": 0, "scale": [2.0, 2.0, 2.0], "translation": [1, 2, 3]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]}],
        "accessors": [
            {"bufferView": 0, "componentType": code, "type": "VEC3", "count": len(whole), "normalized": normalized}
            | {"min": whole.min(axis=0).tolist(), "max": whole.max(axis=0).tolist()},
            {"bufferView": 1, "componentType": 5120, "type": "VEC3", "count": len(whole), "normalized": True},
            {"bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": faces.size},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(part)} | ({"byteStride": stride} if stride else {})
            for start, part, stride in zip(starts, parts, strides, strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    return b"".join(GlbFile._made(described, b"".join(parts)))


@pytest.mark.parametrize("kind", ["<u2", "<i2", "<u1", "<i1"])
@pytest.mark.parametrize("normalized", [False, True])
def test_whole_numbers_are_read_as_they_are_and_written_rounded(kind, normalized):
    data, largest = quantized(kind, normalized=normalized), np.iinfo(kind).max
    file = read(data)
    assert written(file) == data
    step = 1 / largest if normalized else 1.0
    assert np.ptp(file.positions) == pytest.approx(step * (largest if kind[1] == "u" else 2 * largest))
    wanted = cn.denoise(file.mesh, method="laplacian", fixed=np.arange(100)).vertices
    moved = file.with_vertices(wanted)
    assert moved.positions[:100].tobytes() == file.positions[:100].tobytes()
    assert np.abs(moved.positions - wanted).max() <= 0.51 * step  # rounded to single precision first
    again = read(written(moved))
    assert again.positions.tobytes() == moved.positions.tobytes()
    bounds = document(written(moved))["accessors"][0]
    whole = np.rint(again.positions / step)
    assert (bounds["min"], bounds["max"]) == (whole.min(axis=0).tolist(), whole.max(axis=0).tolist())
    assert all(isinstance(number, int) for number in bounds["min"])
    normals = again._stored_normals.read(again._buffers.data)
    assert (normals * again.mesh.vertex_normals).sum(axis=1)[100:].min() > 0.97


def test_whole_numbers_end_at_those_of_their_type():
    file = read(quantized())
    out = file.with_vertices(3.0 * file.mesh.vertices - 50_000)
    assert (out.positions.min(), out.positions.max()) == (0, 65535)
    assert read(written(out)).positions.tobytes() == out.positions.tobytes()


@pytest.mark.parametrize("limit", [0.0, 0.4, 1.0, 1.5, 4.0])
def test_rounding_to_whole_numbers_goes_not_beyond_the_limit(tmp_path, limit):
    source, output = tmp_path / "ball.glb", tmp_path / "out.glb"
    source.write_bytes(quantized("<u1"))
    cn.denoise_file(source, output, method="laplacian", max_displacement=limit)
    moves = np.linalg.norm(cn.read(output).positions - cn.read(source).positions, axis=1)
    assert moves.max() <= limit
    assert (limit >= 1) == (moves.max() > 0)


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


def with_attribute(name: str, values: np.ndarray, **described_too: object) -> bytes:
    """The quantised ball with one more attribute of its vertices."""
    data = quantized()
    described = document(data)
    size, kind = described["buffers"][0]["byteLength"], {"f": 5126, "u": 5123}[values.dtype.kind]
    described["meshes"][0]["primitives"][0]["attributes"][name] = len(described["accessors"])
    described["accessors"].append({"bufferView": 3, "componentType": kind, "count": len(values), **described_too})
    described["bufferViews"].append({"buffer": 0, "byteOffset": size, "byteLength": values.nbytes})
    described["buffers"][0]["byteLength"] += values.nbytes
    return b"".join(GlbFile._made(described, data[-size:] + values.tobytes()))


def test_texture_coordinates_in_whole_numbers_that_stand_for_parts_of_one_go_along(tmp_path, capsys):
    stored = np.random.default_rng(0).integers(0, 65536, (len(COARSE.vertices), 2), np.uint16)
    source, out = tmp_path / "ball.glb", tmp_path / "ball.ply"
    source.write_bytes(with_attribute("TEXCOORD_0", stored, type="VEC2", normalized=True))
    assert run(["denoise", str(source), *FAST, "-o", str(out)]) == 0
    assert "TEXCOORD" not in capsys.readouterr().err
    values = cn.read(out).content().vertex_values
    np.testing.assert_allclose(np.stack([values["s"], 1 - values["t"]], axis=1), stored / 65535, atol=1e-6)


def test_attributes_that_other_formats_cannot_hold_are_named(tmp_path, capsys):
    whole = np.ones((len(COARSE.vertices), 2), np.uint16)
    source = tmp_path / "ball.glb"
    for name, values, kind in (("TEXCOORD_0", whole, "VEC2"), ("TANGENT", np.ones((len(whole), 4), "<f4"), "VEC4")):
        source.write_bytes(with_attribute(name, values, type=kind))
        assert run(["denoise", str(source), *FAST, "-o", str(tmp_path / "ball.ply"), "--force"]) == 0
        assert f"left out: the attribute {name} of vertices" in capsys.readouterr().err


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


def changed(change) -> io.MeshFile:
    found = json.loads(gltf())
    change(found)
    return read(json.dumps(found).encode())


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


TWO_MESHES = {
    "asset": {"version": "2.0"},
    "meshes": [
        {"name": name, "primitives": [{"attributes": {"POSITION": i}, "indices": 2}]} for i, name in enumerate("ab")
    ],
    "accessors": [
        *({"bufferView": i, **VEC3, "count": len(BALL.vertices)} for i in range(2)),
        {"bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": BALL.faces.size},
    ],
    "bufferViews": [{"buffer": i, "byteLength": size} for i, size in enumerate((1944, 1944, 1920))],
    "buffers": [{"uri": f"{name}.bin", "byteLength": size} for name, size in (("p", 1944), ("q", 1944), ("out", 1920))],
}


@pytest.fixture
def two_meshes(tmp_path, monkeypatch):
    """A folder with a glTF file of two meshes, each with positions in a file of its own, and indices in a third."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.gltf").write_text(json.dumps(TWO_MESHES))
    for name, shift in ("p", 0), ("q", 5):
        (tmp_path / f"{name}.bin").write_bytes((BALL.vertices + shift).astype("<f4").tobytes())
    (tmp_path / "out.bin").write_bytes(BALL.faces.astype("<u2").tobytes())
    (tmp_path / "elsewhere").mkdir()
    return tmp_path


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


@pytest.mark.parametrize("uri", ["../secret", "a/../../secret", "%2e%2e/secret", "..%5Csecret", "c:secret", "/secret"])
def test_nothing_outside_the_folder_is_read(two_meshes, uri, capsys):
    inside = two_meshes / "inside"
    inside.mkdir()
    (two_meshes / "secret").write_bytes((two_meshes / "p.bin").read_bytes())
    for name in "in.gltf", "q.bin", "out.bin":
        (two_meshes / name).rename(inside / name)
    (inside / "in.gltf").write_text((inside / "in.gltf").read_text().replace("p.bin", uri))
    assert run(["denoise", "inside/in.gltf", *FAST, "-o", "secret.glb"]) == 3
    assert re.search("outside the folder of this file|only relative file names", capsys.readouterr().err)


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


@pytest.mark.parametrize("uri", [".", "a" * 3000, "a\0b.png", "../p.png", "p.png/q.png"])
def test_images_that_cannot_be_are_named(two_meshes, uri, capsys):
    (two_meshes / "in.gltf").write_text(json.dumps({**TWO_MESHES, "images": [{"uri": uri}]}))
    assert run(["denoise", "in.gltf", *FAST, "-o", "elsewhere/out.gltf", "--json"]) == 0
    (left_out,) = json.loads(capsys.readouterr().out)["left_out"]
    assert left_out.startswith("the file '") and len(left_out) < 130
