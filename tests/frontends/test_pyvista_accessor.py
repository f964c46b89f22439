"""`mesh.cascadenorm`: the same vertices as `denoise`, arrays kept, blocks with shared walls together."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from partitions import walls
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.mesh import Mesh

# importing pyvista takes seconds, and every worker collects this file: only the tests import it
pytestmark = pytest.mark.skipif(not find_spec("pyvista"), reason="pyvista is not installed")

ROOT = Path(__file__).parents[2]
BALL = noisy(icosphere(2), 0.2)
RIGHT = BALL.vertices[:, 0] > 0
UPPER = BALL.vertices[BALL.faces].mean(axis=1)[:, 2] > 0
METHOD = {"method": "bilateral-normal", "iterations": 5}


def polydata(mesh, dtype=np.float32):
    import pyvista

    return pyvista.PolyData.from_regular_faces(mesh.vertices.astype(dtype), mesh.faces)


@pytest.fixture
def ball():
    mesh = polydata(BALL)
    mesh.point_data["heat"] = np.arange(162.0)
    mesh.point_data["weight"] = np.where(RIGHT, 255, 0).astype(np.uint8)
    mesh.cell_data["label"] = np.where(UPPER, 2, 1)
    mesh.cell_data["Normals"] = np.zeros((320, 3), np.float32)
    mesh.field_data["unit"] = ["mm"]
    return mesh


def test_pyvista_finds_it_without_an_import_and_imports_it_on_first_use(tmp_path):
    code = """
import sys, pyvista
mesh = pyvista.Icosphere(nsub=1)
assert "cascadenorm" in dir(mesh) and "cascadenorm" not in sys.modules
print(type(mesh.cascadenorm).__name__, type(pyvista.MultiBlock().cascadenorm).__name__)"""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["PolyDataAccessor", "BlocksAccessor"]


def test_it_denoises_a_copy_and_keeps_the_data(ball):
    import pyvista

    out = ball.cascadenorm.denoise(strength=0.5, **METHOD)
    expected = cn.denoise(BALL.vertices.astype(np.float32), BALL.faces, strength=0.5, **METHOD)
    assert type(out) is pyvista.PolyData
    assert out.points.dtype == np.float32 and out.points.tobytes() == expected.tobytes()
    assert ball.points.tobytes() == BALL.vertices.astype(np.float32).tobytes()
    np.testing.assert_array_equal(out.regular_faces, BALL.faces)
    np.testing.assert_array_equal(out.point_data["heat"], np.arange(162.0))
    np.testing.assert_array_equal(out.cell_data["label"], np.where(UPPER, 2, 1))
    assert list(out.field_data["unit"]) == ["mm"]
    np.testing.assert_allclose(out.cell_data["Normals"], Mesh(expected, BALL.faces).face_normals, atol=1e-6)
    assert not ball.cell_data["Normals"].any()


def test_lines_and_vertex_cells_beside_the_triangles_are_kept(ball):
    mesh = polydata(BALL)
    mesh.lines, mesh.verts = [2, 0, 1], [1, 5, 1, 6]
    mesh.cell_data["label"] = [0, 0, 0, *ball.cell_data["label"]]
    mesh.cell_data["Normals"] = np.concatenate([np.ones((3, 3), np.float32), ball.cell_data["Normals"]])
    out, plain = (one.cascadenorm.denoise(only="label=2", **METHOD) for one in (mesh, ball))
    assert out.points.tobytes() == plain.points.tobytes() != mesh.points.tobytes()
    assert out.lines.tolist() == [2, 0, 1] and out.verts.tolist() == [1, 5, 1, 6]
    normals = out.cell_data["Normals"]
    assert (normals[:3] == 1).all() and normals[3:].tobytes() == plain.cell_data["Normals"].tobytes()
    assert mesh.cascadenorm.inspect().faces == 320


def test_arrays_are_controls_by_their_names(ball):
    by_name = ball.cascadenorm.denoise(mask="weight", only="label=2", **METHOD)
    given = cn.denoise(ball, mask=RIGHT, only=UPPER, **METHOD)
    assert by_name.points.tobytes() == given.points.tobytes() != ball.points.tobytes()
    ball.point_data["right"] = RIGHT
    assert ball.cascadenorm.denoise(mask="right", only="label=2", **METHOD).points.tobytes() == given.points.tobytes()
    fixed = ball.cascadenorm.denoise(fixed="weight", **METHOD)
    assert fixed.points[RIGHT].tobytes() == ball.points[RIGHT].tobytes()
    assert fixed.points[~RIGHT].tobytes() != ball.points[~RIGHT].tobytes()
    with pytest.raises(cn.ParameterError, match="mask is 'wait', which is not an array of the points; there are: heat"):
        ball.cascadenorm.denoise(mask="wait")
    with pytest.raises(cn.ParameterError, match="only is 'steel'; it must be a number"):
        ball.cascadenorm.denoise(only="label=steel")
    with pytest.raises(cn.ParameterError, match="only matches no cell with 'label=11'"):
        ball.cascadenorm.denoise(only="label=11")


def test_it_inspects_and_compares(ball):
    true = polydata(icosphere(2))
    assert ball.cascadenorm.inspect().faces == 320
    measures = ball.cascadenorm.compare(true)
    assert measures == cn.compare(ball, true)
    assert measures.normal_error_deg > ball.cascadenorm.denoise(**METHOD).cascadenorm.compare(true).normal_error_deg


def test_blocks_keep_their_walls_shared_their_names_and_their_nesting():
    import pyvista

    found = walls("half balls")
    parts = [found.region(label) for label in (1, 2)]
    blocks = pyvista.MultiBlock({"left": polydata(parts[0], float), "none": None})
    blocks["inner"] = pyvista.MultiBlock({"right": polydata(parts[1], float)})
    blocks["left"].cell_data["label"] = np.ones(len(parts[0].faces))
    blocks.field_data["unit"] = ["mm"]
    out = blocks.cascadenorm.denoise(**METHOD)
    expected = cn.denoise_regions(parts, **METHOD)
    assert type(out) is pyvista.MultiBlock and out.keys() == ["left", "none", "inner"]
    assert out["none"] is None and out["inner"].keys() == ["right"]
    assert out["left"].points.tobytes() == expected[0].vertices.tobytes() != parts[0].vertices.tobytes()
    assert out["inner"]["right"].points.tobytes() == expected[1].vertices.tobytes()
    assert out["left"].cell_data["label"].all() and list(out.field_data["unit"]) == ["mm"]
    blocks["inner"].append(pyvista.ImageData(dimensions=(2, 2, 2)), "picture")
    with pytest.raises(cn.MeshError, match=r"^picture: .*ImageData is not a supported kind of mesh"):
        blocks.cascadenorm.denoise()


def test_the_progress_bar_is_shown_and_a_listener_can_end_the_work(ball, capfd):
    shares = []
    out = ball.cascadenorm.denoise(progress_bar=True, progress=shares.append, **METHOD)
    assert "Denoising: 100%" in capfd.readouterr().err
    assert shares[-1] == 1
    assert out.points.tobytes() == ball.cascadenorm.denoise(**METHOD).points.tobytes()
    assert "Denoising" not in capfd.readouterr().err

    def stop(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ball.cascadenorm.denoise(progress=stop, **METHOD)


def test_other_cells_are_refused_with_the_way_out():
    import pyvista

    with pytest.raises(cn.MeshError, match=r"call its triangulate\(\) first"):
        pyvista.Plane().cascadenorm.denoise()


@pytest.mark.slow  # a process that denoises and draws with VTK in software
def test_the_picture_of_the_documentation_is_drawn_off_screen(tmp_path):
    image = pytest.importorskip("PIL.Image")
    run = [sys.executable, ROOT / "docs" / "generate" / "pyvista_picture.py", tmp_path / "drawn.png"]
    done = subprocess.run(run, capture_output=True, text=True)
    if done.returncode < 0 or "Failed to load" in done.stderr:
        pytest.skip(f"VTK cannot draw off screen here: {done.stderr}")
    assert done.returncode == 0, done.stderr
    pictures = [image.open(path).convert("L") for path in (tmp_path / "drawn.png", ROOT / "docs" / "pyvista.png")]
    drawn, stored = (np.asarray(picture, float) for picture in pictures)
    assert drawn.shape == stored.shape and np.abs(drawn - stored).mean() < 2  # of 255; lines differ with the driver
    noisy, smooth, true = (np.abs(np.diff(part[60:])).mean() for part in np.split(drawn, 3, axis=1))
    assert noisy > 1.5 * smooth and abs(smooth - true) < 0.2 * true
