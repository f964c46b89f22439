"""The commands that draw write the picture of their options."""

import numpy as np
import PIL.Image
import pytest
from commands import refused
from pictures import decoded_size
from shapes import grid, icosphere, noisy

from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh

BALL = icosphere(3)
ROUGH = noisy(BALL, 0.3)


def test_the_mesh_that_does_not_fit_the_reference_is_named(place, capsys):
    save_mesh(place / "other.ply", grid(3, 3))
    code, message = refused(
        capsys, *["render", "ball.ply", "true.ply", "-o", "a.png", "--values", "angle", "--reference", "other.ply"]
    )
    assert code == 4 and "mesh 1 does not have the same faces as the mesh that it is compared with" in message


def test_render_draws_meshes_side_by_side(place, capsys):
    assert run(["render", "ball.ply", "true.ply", "-o", "both.png", "--size", "40"]) == 0
    assert capsys.readouterr().out == "both.png\n"
    data = (place / "both.png").read_bytes()
    assert data.startswith(b"\x89PNG") and int.from_bytes(data[16:20], "big") >= 80
    assert refused(capsys, "render", "ball.ply", "-o", "both.png")[0] == 5
    assert (place / "both.png").read_bytes() == data
    assert refused(capsys, "render", "absent.ply", "-o", "new.png")[0] == 3


@pytest.mark.compiled
def test_meshes_are_seen_from_where_one_is_told(tmp_path):
    flat = icosphere(2).moved(icosphere(2).vertices * (1, 1, 0.1))
    height = []
    for name, view in (("front", "0,0,1"), ("side", "-2,0,0")):
        save_mesh(tmp_path / "flat.ply", flat, force=True)
        arguments = ["render", str(tmp_path / "flat.ply"), "-o", str(tmp_path / f"{name}.png"), "--size", "64"]
        assert run([*arguments, f"--view={view}"]) == 0
        with PIL.Image.open(tmp_path / f"{name}.png") as picture:
            dark = np.asarray(picture.convert("L"))[:64] < 250
        height.append(np.ptp(np.argwhere(dark)[:, 1]) / np.ptp(np.argwhere(dark)[:, 0]))
    assert height[0] == pytest.approx(1, abs=0.05) and height[1] == pytest.approx(0.1, abs=0.05)


@pytest.mark.parametrize("view", ["1", "a,b,c", "sideways", "0,0,0", "nan,0,1", "inf,0,1"])
def test_a_view_is_three_numbers(view, tmp_path, capsys):
    assert run(["render", "any.ply", "-o", str(tmp_path / "x.png"), f"--view={view}"]) == 2
    assert "--view" in capsys.readouterr().err


def test_a_picture_of_the_command_line_has_all_of_it(tmp_path, capsys):
    for name, mesh in (("a.ply", ROUGH), ("b.ply", BALL)):
        save_mesh(tmp_path / name, mesh)
    command = ["render", str(tmp_path / "a.ply"), str(tmp_path / "b.ply"), "-o", str(tmp_path / "x.png")]
    more = ["--size", "64", "--view", "30,20", "--up", "z", "--values", "distance", "--limits", "0,0.1", "--crop"]
    assert run([*command, *more, "0.5,0.5,0.3", "--smooth", "--wireframe", "--transparent"]) == 0
    assert decoded_size(tmp_path / "x.png") > (2 * 64, 2 * 64)
    assert run([*command, "--up", "w"]) == 2 and run([*command, "--crop", "0.5,0.5"]) == 2
    assert run(command[:-2]) == 2 and "nothing to write" in capsys.readouterr().err
