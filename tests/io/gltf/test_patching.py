"""Patches that close holes of a glTF file are stored as the vertices around them are."""

import pytest
from gltfs import COARSE, document, quantized

import cascadenorm as cn
from cascadenorm.api.filled_files import fill_holes_file


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
