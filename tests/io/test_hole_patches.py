"""Values on the patches of holes go on from those around them."""

import io

import numpy as np
import pytest
from holed_ball import COUNT, FACES, FILLED, HEIGHT, HOLED, filled, ply_binary, ply_text

import cascadenorm as cn
from cascadenorm.io.hole_patches import HolePatches


@pytest.mark.parametrize("data", [ply_text(), ply_binary("<"), ply_binary(">")], ids=["text", "little", "big"])
def test_new_vertices_and_faces_of_ply_have_values_like_those_around(tmp_path, data):
    file, _ = filled(tmp_path, data, ".ply")
    before, after = cn.read(io.BytesIO(data)).content(), file.content()
    for old, new in ((before.vertex_values, after.vertex_values), (before.face_values, after.face_values)):
        assert old.keys() == new.keys()
        for name in old:
            assert new[name][: len(old[name])].tobytes() == old[name].tobytes()
    assert np.abs(after.vertex_values["green"] - (100 + 50 * FILLED.vertices[:, 2])).max() < 8
    numbers = after.vertex_values["number"][COUNT:].astype(int)
    assert np.linalg.norm(FILLED.vertices[numbers] - FILLED.vertices[COUNT:], axis=1).max() < 0.5
    sides = after.face_values["side"][FACES:]
    clear = np.abs(FILLED.centroids[FACES:, 0]) > 0.1
    np.testing.assert_array_equal(sides[clear], FILLED.centroids[FACES:, 0][clear] > 0)
    if "nx" in after.vertex_values:
        normals = np.stack([after.vertex_values[name][COUNT:] for name in ("nx", "ny", "nz")], axis=1)
        assert (normals * -FILLED.vertices[COUNT:]).sum(axis=1).min() > 0.95
    near = file._columns["vertex", "near"]
    assert np.broadcast_to(near.counts, len(file.positions))[COUNT - 1 : COUNT + 1].tolist() == [2, 0]
    assert file._columns["rest", "last"].read(file._body).tolist() == [77]


@pytest.mark.parametrize(("kind", "one"), [("char", 127), ("short", 32767), ("uchar", 255)])
def test_normals_in_whole_numbers_go_on_at_their_scale(tmp_path, kind, one):
    normals = [f"property {kind} n{axis}" for axis in "xyz"]
    header = ["ply", "format ascii 1.0", f"element vertex {COUNT}", *(f"property float {axis}" for axis in "xyz")]
    header += [*normals, f"element face {FACES}", "property list uchar int vertex_indices", *normals, "end_header"]
    true = [HOLED.vertex_normals, HOLED.face_normals]
    stored = [np.rint(one * (np.abs(values) if kind == "uchar" else values)).astype(int) for values in true]
    rows = [" ".join(map(str, (*p, *n))) for p, n in zip(HOLED.vertices.tolist(), stored[0].tolist(), strict=True)]
    rows += [" ".join(map(str, (3, *f, *n))) for f, n in zip(HOLED.faces.tolist(), stored[1].tolist(), strict=True)]
    content = filled(tmp_path, ("\n".join([*header, *rows]) + "\n").encode(), ".ply")[0].content()
    added = FILLED.vertices[COUNT:], FILLED.centroids[FACES:]
    for values, true in zip((content.vertex_values, content.face_values), added, strict=True):
        new = np.stack([values[name] for name in ("nx", "ny", "nz")], axis=1)[-len(true) :].astype(float)
        assert (new * (np.abs(true) if kind == "uchar" else true)).sum(axis=1).min() > 0.8 * one


@pytest.mark.parametrize("odd", [np.nan, np.inf])
def test_values_are_blended_where_they_are_finite_and_else_the_nearest(odd):
    patches = HolePatches(cn.io.from_arrays(HOLED.vertices, HOLED.faces), FILLED)
    blended = patches.blended(HEIGHT)
    known = np.concatenate([HEIGHT, blended])
    for vertex in range(COUNT, len(FILLED.vertices)):
        around = FILLED.topology.vertex_neighbors.row(vertex)
        assert known[vertex] == pytest.approx(known[around].mean(), rel=1e-12)
    boundary = HOLED.topology.boundary_vertices
    spoiled = np.where(boundary, HEIGHT, odd)
    np.testing.assert_array_equal(patches.blended(spoiled), patches.nearest(HEIGHT))
    assert set(patches.nearest(np.arange(COUNT))) <= set(np.flatnonzero(boundary))
