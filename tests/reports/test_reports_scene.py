"""The scene of the viewer holds the meshes and their values as precisely as they can be seen."""

import json
import re

import numpy as np
import pytest
from report_contents import CLEAN, ROUGH, scene_of, unpacked
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.io.content import Content
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons
from cascadenorm.reports.given import given
from cascadenorm.reports.scene import Comparison, viewer_scene


def test_positions_are_off_by_half_a_level_and_the_result_by_as_much(place):
    out = cn.denoise(ROUGH, method="laplacian")
    cn.report("r.html", ROUGH, out)
    scene = scene_of(place / "r.html")
    before, after = scene["meshes"]
    assert (before["like"], after["like"], after["triangles"]) == (None, "before", None)
    codes = unpacked(before["positions"])
    for mesh, levels in ((ROUGH, codes), (out, codes + unpacked(after["positions"]))):
        back = np.array(scene["lower"]) + levels / scene["levels"] * scene["extent"]
        assert np.abs(back - mesh.vertices).max() <= 0.501 / scene["levels"] * max(scene["extent"])


def test_a_part_far_away_leaves_a_mesh_its_precision(place):
    vertices = np.vstack([CLEAN.vertices, np.eye(3) + 5000])
    cn.report("r.html", Mesh(vertices, np.vstack([CLEAN.faces, np.arange(3) + len(CLEAN.vertices)])))
    scene = scene_of(place / "r.html")
    codes = unpacked(scene["meshes"][0]["positions"])
    back = np.array(scene["lower"]) + codes / scene["levels"] * scene["extent"]
    assert np.abs(back - vertices).max() < 1e-3
    assert np.linalg.norm(scene["view"]["target"]) < 0.2 and max(scene["view"]["reach"]) < 1.5


@pytest.mark.parametrize("scale", [1e300, 1e-310])
def test_coordinates_of_any_size_are_shown(place, scale):
    out = cn.denoise(ROUGH, method="laplacian")
    cn.report("r.html", ROUGH.moved(ROUGH.vertices * scale), out.moved(out.vertices * scale))
    scene = scene_of(place / "r.html")
    assert max(scene["extent"]) == pytest.approx(2 * scale, rel=0.2)
    angle = next(field for field in scene["fields"] if field["name"] == "angle")
    assert 1 < angle["limits"][1] < 90


def test_meshes_with_other_faces_are_shown_beside_each_other(place):
    measures = cn.report("r.html", cube(4), truth=cube(2)).measures["mesh"]
    assert measures == cn.compare(cube(4), cube(2))
    scene = scene_of(place / "r.html")
    assert [mesh["like"] for mesh in scene["meshes"]] == [None, None]
    assert [mesh["faces"] for mesh in scene["meshes"]] == [192, 48]


def test_colors_and_the_numbers_of_faces_are_those_of_the_file(place):
    square = grid(2, 2)
    corners = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
    red = np.arange(9, dtype=np.uint8) * 20
    values = {"red": red, "green": red[::-1].copy(), "blue": np.full(9, 7, np.uint8)}
    content = Content(square.vertices, Polygons.from_rows(corners), vertex_values=values)
    (place / "quads.ply").write_bytes(b"".join(PlyFile.encode(content)[0]))
    cn.report("r.html", "quads.ply")
    (mesh,) = scene_of(place / "r.html")["meshes"]
    np.testing.assert_array_equal(unpacked(mesh["colors"]), np.stack([*values.values()], axis=1))
    assert unpacked(mesh["numbers"]).tolist() == [0, 0, 1, 1, 2, 2, 3, 3]


def test_what_completes_a_scene_holds_what_the_scene_of_both_holds(place):
    result = cn.denoise(ROUGH, method="laplacian")
    before, after = given("before", ROUGH), given("after", result)
    comparison = Comparison(before)
    first, rest, whole = (
        comparison.first,
        comparison.with_result(after, result.vertices),
        viewer_scene([before, after], []),
    )
    assert rest["completes"] and [mesh["name"] for mesh in rest["meshes"]] == ["after"]
    assert [field["name"] for field in rest["fields"]] == [field["name"] for field in whole["fields"]]

    lower, extent = np.array(first["lower"]), np.array(first["extent"])
    codes = unpacked(first["meshes"][0]["positions"]) + unpacked(rest["meshes"][0]["positions"])
    np.testing.assert_allclose(lower + codes / first["levels"] * extent, result.vertices, atol=extent.max() / 65_000)

    def values(field, name):
        pack = field["values"][field["of"][name]]
        return pack["start"] + pack["step"] * (unpacked(pack["codes"]) - 1), pack["step"]

    for field, same in zip(rest["fields"], whole["fields"], strict=True):
        assert field["limits"] == pytest.approx(same["limits"])
        for name in same["of"]:
            (found, step), (wanted, other) = values(field, name), values(same, name)
            np.testing.assert_allclose(found, wanted, atol=step + other)


def test_a_result_that_leaves_the_box_has_a_scene_of_its_own():
    comparison = Comparison(given("before", ROUGH))
    large = ROUGH.moved(3 * ROUGH.vertices)
    found = comparison.with_result(given("after", large), large.vertices)
    assert [mesh["name"] for mesh in found["meshes"]] == ["before", "after"] and found["extent"][0] > 5


def test_what_has_no_room_has_coarser_values_and_then_fewer_faces(monkeypatch):
    shown = [given("before", ROUGH), given("after", CLEAN)]

    def made(most):
        monkeypatch.setattr("cascadenorm.reports.scene.MOST_TEXT", most)
        found = viewer_scene(shown, [])
        arrays = re.findall(r'"data": "([^"]*)"', json.dumps(found))
        assert sum(map(len, arrays)) <= most
        angle = next(field for field in found["fields"] if field["name"] == "angle")["values"][0]
        return sum(map(len, arrays)), angle["step"], angle["codes"]["shape"][0]

    size, step, faces = made(10**6)
    assert faces == len(ROUGH.faces)
    smaller, coarser, as_many = made(size - 1)
    assert smaller < size and coarser == pytest.approx(250 / 64 * step) and as_many == faces
    assert made(smaller - 1)[2] < faces


def test_a_mesh_that_is_in_no_file_has_none_in_the_scene(place):
    named, unnamed = given("before", "rough.ply"), given("after", CLEAN)
    assert [mesh["file"] for mesh in viewer_scene([named, unnamed], [])["meshes"]] == ["rough.ply", ""]


@pytest.mark.slow  # a million faces
@pytest.mark.parametrize("with_truth", [False, True])
def test_a_million_faces_take_less_than_twelve_million_bytes(place, with_truth):
    ball = icosphere(8)  # in no regular order
    lowest = np.sort(np.argsort(ball.centroids[:, 2])[:1_000_000])
    used, faces = np.unique(ball.faces[lowest], return_inverse=True)
    clean = Mesh(ball.vertices[used], faces.reshape(-1, 3))
    cn.report("r.html", noisy(clean, 0.2), noisy(clean, 0.02), truth=clean if with_truth else None)
    assert (place / "r.html").stat().st_size < 12e6
