"""The open mesh is shown beside its result, without what is bad in it."""

import numpy as np
from scans import LAPLACIAN, ROUGH, denoised, scanned, settings
from studios import until


def test_the_scene_of_a_result_completes_that_of_the_open_mesh(studio):
    with studio.told() as events:
        opened = until(events, type="opened")
        shown = denoised(studio, events, settings(strength=0.25))
        first = studio.asked("GET", f"/api/scene/{opened['scene']}")[1]
    status, scene = studio.asked("GET", f"/api/scene/{shown['scene']}")
    assert status == 200 and [mesh["name"] for mesh in first["meshes"]] == ["before"]
    assert scene["completes"] and [mesh["name"] for mesh in scene["meshes"]] == ["after"]
    assert [mesh["file"] for mesh in (*first["meshes"], *scene["meshes"])] == ["scan.ply", "scan_denoised.ply"]
    assert studio.asked("GET", f"/api/scene/{shown['scene']}", authorization="Bearer wrong")[0] == 401
    assert studio.asked("GET", "/api/scene/99999")[0] == 404


def test_bad_vertices_are_left_and_said(drop_studio, tmp_path):
    vertices = ROUGH.vertices.copy()
    vertices[5, 0] = np.nan
    scanned(tmp_path / "bad.ply", type("Rough", (), {"vertices": vertices, "faces": ROUGH.faces}))
    assert drop_studio.drop(tmp_path / "bad.ply")[0] == 200
    with drop_studio.told() as events:
        assert "1 of 642 vertices are not finite" in until(events, type="opened")["notice"]
    done = drop_studio.done("/api/recipe", {"settings": LAPLACIAN, "name": "out.ply"})
    assert "--on-bad isolate" in done["command"]
