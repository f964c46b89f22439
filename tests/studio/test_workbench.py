"""The open mesh is shown beside its result, without what is bad in it."""

import json

import numpy as np
from scans import LAPLACIAN, ROUGH, denoised, scanned, settings
from shapes import grid, noisy
from studios import until

from cascadenorm.io.interop import save_mesh
from cascadenorm.studio.workbench import COARSE, Workbench


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


def test_a_coarse_preview_comes_before_the_first_result_of_a_large_mesh(tmp_path):
    large = noisy(grid(183, 183), 0.2)
    save_mesh(tmp_path / "large.ply", large)
    bench, previews = Workbench(tmp_path / "large.ply", "large.ply"), []
    shown = [bench.denoise(asked, lambda fraction: None, previews.append) for asked in (LAPLACIAN, LAPLACIAN)]
    assert shown[0]["moved"] == shown[1]["moved"] > 0
    (preview,) = (json.loads(scene)["meshes"] for scene in previews)
    whole = json.loads(shown[0]["scene"])["meshes"]
    assert preview[-1]["positions"]["shape"][0] < whole[-1]["positions"]["shape"][0] / 2
    assert preview[-1]["faces"] == whole[-1]["faces"] == len(large.faces) > 2 * COARSE

    # another strength only blends what is known, so that no coarse mesh comes before it
    bench.denoise({**LAPLACIAN, "controls": {"strength": "0.25"}}, lambda fraction: None, previews.append)
    assert len(previews) == 1
