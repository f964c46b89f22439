"""Positions of glTF in whole numbers (KHR_mesh_quantization)."""

import numpy as np
import pytest
from gltfs import COARSE, FAST, document, quantized, with_attribute
from sample_files import read, written

import cascadenorm as cn
from cascadenorm.api.filled_files import fill_holes_file
from cascadenorm.cli import run
from cascadenorm.io.gltf.gltf import GlbFile


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


@pytest.mark.parametrize("kind", ["<u2", "<i2", "<u1", "<i1"])
@pytest.mark.parametrize("normalized", [False, True])
def test_a_patch_has_whole_numbers_as_well(tmp_path, kind, normalized):
    source, output = tmp_path / "holed.glb", tmp_path / "out.glb"
    faces = COARSE.faces[COARSE.centroids[:, 2] < 0.8]
    source.write_bytes(quantized(kind, normalized=normalized, faces=faces))
    before = cn.read(source)
    done = fill_holes_file(source, output)
    after = cn.read(output)
    assert done.closed == 1 and len(after.mesh.vertices) > len(before.mesh.vertices)
    assert after.mesh.topology.edge_faces.counts.min() == 2
    assert after.positions[: len(before.positions)].tobytes() == before.positions.tobytes()
    primitive = document(output.read_bytes())["meshes"][0]["primitives"][1]
    accessor = document(output.read_bytes())["accessors"][primitive["attributes"]["POSITION"]]
    assert accessor["componentType"] == document(source.read_bytes())["accessors"][0]["componentType"]
    assert accessor.get("normalized", False) == normalized
    patch = after._accessors.values(primitive["attributes"]["POSITION"])
    assert (accessor["min"], accessor["max"]) == (patch.min(axis=0).tolist(), patch.max(axis=0).tolist())


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
