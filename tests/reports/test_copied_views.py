"""Views of a report, copied as commands that draw them."""

import numpy as np
import pytest
from browsers import needs_browser
from PIL import Image
from report_pages import CLEAN, ROUGH

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh


@needs_browser
@pytest.mark.parametrize("up", ["y", "z"])
def test_the_view_is_copied_as_a_command_that_draws_it(browser, tmp_path, monkeypatch, up):
    """The mesh covers the same pixels, and a face has the same colour."""
    far = np.array([50.0, -20.0, 7.0])
    for name, mesh in (("before", ROUGH), ("true", CLEAN)):
        save_mesh(tmp_path / f"{name}.ply", mesh.moved(8 * mesh.vertices + far))
    cn.report(tmp_path / "r.html", tmp_path / "before.ply", truth=tmp_path / "true.ply")
    state = "mode=one&left=mesh&light=clay&color=normal-error&limits=0,40&view=0.6,0.2,0.8,0.1,0.05,0,1.9"
    browser.open(tmp_path / "r.html", f"{state}&up={up}")
    canvas = browser.canvas()
    height, width, _ = canvas.shape
    command = browser.copied_view()
    monkeypatch.chdir(tmp_path)
    assert command[:2] == ["cascadenorm", "render"]
    assert {"--values=normal-error", "--limits=0,40"} <= set(command)
    assert ("--up=z" in command) == (up == "z")
    assert run([*command[1:], "--size", str(height)]) == 0
    with Image.open(tmp_path / "view.png") as picture:
        drawn = np.asarray(picture.convert("RGB")).astype(int)[:height, :height]
    left = (width - height) // 2
    seen = canvas[:, left : left + height]
    covered = np.abs(drawn - 255).max(axis=2) > 10
    background = (np.abs(seen - seen[-1, 2]) < 4).all(axis=2)
    names = 45
    assert 0.2 < covered.mean() < 0.95
    assert (covered[names:] == ~background[names:]).mean() > 0.985
    both = covered & ~background
    both[:names] = False
    assert np.median(np.abs(drawn - seen)[both]) <= 3


@needs_browser
def test_a_file_name_that_begins_with_a_hyphen_is_no_option_of_the_command(browser, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / "-h rough.ply", ROUGH)
    save_mesh(tmp_path / "-true.ply", CLEAN)
    cn.report("r.html", "-h rough.ply", truth="-true.ply")
    browser.open(tmp_path / "r.html", "mode=one&left=mesh&color=distance")
    assert run(browser.copied_view()[1:]) == 0 and (tmp_path / "view.png").exists()
