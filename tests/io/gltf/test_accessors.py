"""Numbers of glTF accessors are read and written where they lie, in any type, also in whole numbers."""

import json
import re
from base64 import b64decode

import numpy as np
import pytest
from gltfs import COARSE, FAST, TEXT, VEC3, document, quantized, single, with_attribute
from sample_files import glb, read, written

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run


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


def test_content_can_be_read_any_number_of_times(monkeypatch):
    monkeypatch.setattr("cascadenorm.io.limits.ALWAYS", 1.0)
    monkeypatch.setenv("CASCADENORM_MAX_EXPANSION", "2")
    file = read(glb())
    for _ in range(20):
        assert len(file.content().positions) > 0
        assert file.vertex_values == {}


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


def test_texture_coordinates_in_whole_numbers_that_stand_for_parts_of_one_go_along(tmp_path, capsys):
    stored = np.random.default_rng(0).integers(0, 65536, (len(COARSE.vertices), 2), np.uint16)
    source, out = tmp_path / "ball.glb", tmp_path / "ball.ply"
    source.write_bytes(with_attribute("TEXCOORD_0", stored, type="VEC2", normalized=True))
    assert run(["denoise", str(source), *FAST, "-o", str(out)]) == 0
    assert "TEXCOORD" not in capsys.readouterr().err
    values = cn.read(out).content().vertex_values
    np.testing.assert_allclose(np.stack([values["s"], 1 - values["t"]], axis=1), stored / 65535, atol=1e-6)
