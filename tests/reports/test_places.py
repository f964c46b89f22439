"""Findings have places in the unit of the file, whatever the size of its coordinates."""

import numpy as np
import pytest
from report_contents import CLEAN, scene_of, text_of

import cascadenorm as cn
from cascadenorm.io.content import Content
from cascadenorm.io.interop import save_mesh
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons
from cascadenorm.reports.given import Given, given
from cascadenorm.reports.places import places


def test_findings_have_places_in_the_unit_of_the_file(place):
    vertices = np.vstack([CLEAN.vertices * 3 + 10, [[50, 0, 0]]])
    faces = np.vstack([CLEAN.faces, CLEAN.faces[5]])
    save_mesh(place / "bad.obj", Mesh(vertices, faces))
    found = cn.report("r.html", "bad.obj").inspections["mesh"]
    assert found == cn.inspect("bad.obj")
    assert found.duplicate_faces.first == (len(faces),)
    places = {(p["finding"], p["label"]): p for p in scene_of(place / "r.html")["places"]}
    copy = places["duplicate_faces", f"face {len(faces)}"]
    np.testing.assert_allclose(copy["at"], vertices[CLEAN.faces[5]].mean(axis=0), rtol=1e-6)
    alone = places["unreferenced", f"vertex {len(vertices)}"]
    np.testing.assert_allclose(alone["at"], [50, 0, 0])
    assert "1 face duplicates an earlier one" in text_of(place / "r.html")


@pytest.mark.parametrize("scale", [1e-300, 1.0, 1e307])
def test_places_of_huge_and_signalling_coordinates_are_found_in_silence(scale):
    ball = CLEAN.vertices.copy()
    faces = np.concatenate([CLEAN.faces, CLEAN.faces[:1]])
    found = cn.inspect(ball * scale, faces, self_intersections=False)
    one = given("mesh", (ball * scale, faces))
    (place,) = (place for place in places(one, found) if place.finding == "duplicate_faces")
    corners = ball[CLEAN.faces[0]]
    middle = corners.mean(axis=0)
    radius = np.linalg.norm(corners - middle, axis=1).max()
    assert place.at == pytest.approx(tuple(middle * scale)) and place.radius == pytest.approx(radius * scale)

    stored = ball.astype(np.float32)
    stored.view(np.uint32)[0, 0] = 0x7F800001  # a signalling NaN
    file = PlyFile(b"".join(PlyFile.encode(Content(stored, Polygons.from_rows(faces)))[0])).isolating()
    one = Given("mesh", "ball.ply", file)
    listed = places(one, cn.inspect(file))
    assert "duplicate_faces" in {place.finding for place in listed} and np.isfinite([p.radius for p in listed]).all()
