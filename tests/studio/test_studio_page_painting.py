"""Painting in the studio: masks and pinned vertices, and what is asked before they are lost."""

import re
import shlex
from io import BytesIO

import numpy as np
import pytest
from browsers import needs_browser, webdriver
from scans import ROUGH
from selenium.webdriver.common.keys import Keys
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.render import color_map


def under_the_brush(radius, height):
    """Distances of the vertices from what lies in the middle of the canvas, over the radius of the brush there."""
    lower, upper = ROUGH.vertices.min(axis=0), ROUGH.vertices.max(axis=0)
    middle, size = (lower + upper) / 2, (upper - lower).max()
    for corners in ROUGH.corners:
        if corners[:, 2].min() > 0:  # in front
            weights = np.linalg.solve(np.vstack([corners[:, :2].T, np.ones(3)]), [*middle[:2], 1])
            if weights.min() >= 0:
                hit = weights @ corners
    depth = 3.2 * size + middle[2] - hit[2]
    return np.linalg.norm(ROUGH.vertices - hit, axis=1) / (radius * 2 * np.tan(np.radians(15)) * depth / height)


def take(page, tool):
    """Choose a brush, or the view."""
    page.js("document.querySelector(`.painting input[value=${arguments[0]}]`).click()", tool)


def saved(page, folder):
    """The files that are saved, and which vertices are where they were."""
    page.press_button("Save…")
    page.fill("#saving-name", "out.ply")
    page.js("document.querySelector('.saving button[type=submit]').click()")
    page.said(".saving [role=status]", "Saved as")
    page.press_button("Close")
    files = {path.name: path.read_bytes() for path in folder.glob("out*")}
    moved = cn.read(folder / "out.ply").mesh.vertices != cn.read(folder / "rough.ply").mesh.vertices
    for path in folder.glob("out*"):
        path.unlink()
    return files, ~moved.any(axis=1)


@pytest.fixture
def facing(page, named):
    """A page on the studio, with the mesh alone and seen from the front."""
    page.at(named).wait()
    page.fill(".settings select", "laplacian")
    page.begun()
    page.js("location.hash = 'mode=one&left=before&view=0,0,1,0,0,0,3.2'")
    page.settle()
    return page


@needs_browser
def test_a_brush_reaches_what_lies_under_it_and_undo_takes_it_back(facing, named):
    plain = facing.canvas()
    height = min(facing.one("canvas").rect[side] for side in ("width", "height"))
    take(facing, "pin")
    facing.fill(".painting input[type=range][max='120']", "60")
    facing.drag((0, 0))
    facing.begun()
    pinned = facing.canvas()
    assert (np.abs(pinned - plain)[len(plain) // 2] > 20).any()
    files, kept = saved(facing, named.folder)
    away = under_the_brush(60, height)
    assert set(files) == {"out.ply", "out_fixed.npy"} and kept.sum() > 5
    assert kept[away < 0.98].all() and not kept[away > 1.02].any()

    # back and forth again
    facing.one("body").send_keys(Keys.CONTROL, "z")
    facing.begun()
    files, kept = saved(facing, named.folder)
    assert set(files) == {"out.ply"} and not kept.any()
    facing.press_button("Redo")
    facing.begun()
    assert set(saved(facing, named.folder)[0]) == {"out.ply", "out_fixed.npy"}


@needs_browser
@pytest.mark.slow  # six answers, each drawn in software; the other tests paint weights and copy the command as well
def test_half_of_the_displacement_is_kept_along_a_stroke_and_the_command_has_it(facing, named, monkeypatch):
    take(facing, "pin")
    facing.drag((0, 0))
    facing.begun()
    take(facing, "mask")
    facing.fill(".painting input[type=range][max='120']", "60")
    facing.fill(".painting input[type=range][max='100']", "50")
    facing.drag((-80, 100), (80, 0), (80, 0))
    facing.begun()
    files, _ = saved(facing, named.folder)
    weights = np.load(BytesIO(files["out_mask.npy"]))
    assert set(np.unique(weights)) == {0.5, 1.0} and 10 < (weights == 0.5).sum() < 300
    for name in ("out_fixed.npy", "out_mask.npy"):
        (named.folder / name).write_bytes(files[name])
    facing.js("Object.defineProperty(navigator, 'clipboard', {value: undefined})")
    facing.press_button("Copy as command line")
    command = shlex.split(facing.said(".status code", "cascadenorm.*"))
    assert {"out_mask.npy", "out_fixed.npy"} < set(command)
    facing.said(".said", "It reads out_mask.npy and out_fixed.npy: save the result first")
    monkeypatch.chdir(named.folder)
    assert run(command[1:]) == 0
    assert (named.folder / "out.ply").read_bytes() == files["out.ply"]
    for path in named.folder.glob("out*"):
        path.unlink()

    # beside the mesh it turns
    view = facing.address()
    facing.drag((-250, -300), (60, 0))
    assert facing.address() != view

    # back, step by step
    facing.press_button("Undo")
    facing.begun()
    assert set(saved(facing, named.folder)[0]) == {"out.ply", "out_fixed.npy"}
    facing.press_button("Undo")
    facing.begun()
    files, kept = saved(facing, named.folder)
    assert set(files) == {"out.ply"} and not kept.any()


@needs_browser
def test_the_copied_command_draws_the_mesh_without_paint_which_no_file_has(page, named, monkeypatch):
    page.at(named).wait()
    page.js("location.hash = 'mode=one&left=before'")
    page.settle()
    take(page, "pin")
    monkeypatch.chdir(named.folder)
    assert run(page.copied_view()[1:]) == 0 and (named.folder / "view.png").exists()


@needs_browser
def test_a_page_that_is_loaded_again_keeps_its_paint_and_its_result(page, named):
    page.at(named).wait()
    take(page, "pin")
    page.drag((60, 0), (20, 0))
    page.begun()
    moved = f"{len(ROUGH.vertices)} vertices moved"
    assert moved not in page.one(".said").text
    page.at(named).wait()
    assert page.one(".painting > button").is_displayed() and moved not in page.one(".said").text


@needs_browser
@pytest.mark.parametrize("level", [4, 2])
def test_another_mesh_is_opened_after_painting_without_the_paint(page, dropped, tmp_path, level):
    save_mesh(tmp_path / "other.ply", noisy(icosphere(level), 0.2))
    page.at(dropped).wait()
    take(page, "pin")
    page.drag((60, 0), (20, 0))
    page.begun()
    assert page.one(".painting > button").text == "Clear all paint"
    page.drop(tmp_path / "other.ply", replacing=True)
    page.said("h1", "other.ply")
    page.begun()
    after = page.canvas()
    faces = 20 * 4**level
    assert f"{faces:,} faces" in page.one(".counts").text and page.one(".bar .buttons > :last-child").is_enabled()
    assert not page.one(".failed").is_displayed() and not page.one(".painting > button").is_displayed()

    # it looks as it does without another one before it
    page.at(dropped).wait()
    page.drop(tmp_path / "other.ply", replacing=True)
    page.said("h1", "other.ply")
    page.begun()
    assert (page.canvas() == after).all()


@needs_browser
def test_it_is_asked_before_what_is_not_saved_is_lost(page, named, tmp_path):
    save_mesh(tmp_path / "other.ply", noisy(icosphere(2), 0.2))
    page.at(named).wait()
    leaving = "const e = new Event('beforeunload', {cancelable: true}); dispatchEvent(e); return e.defaultPrevented"
    lost = "return document.querySelector('.leaving[open] p')?.innerText"

    # the result is kept, by the button that has the focus and by Escape
    for key in (Keys.ENTER, Keys.ESCAPE):
        page.drop(tmp_path / "other.ply")
        assert page.js(lost) == "The result is not saved and will be lost."
        assert page.one(".leaving h2").text == "Open other.ply in place of rough.ply?"
        assert page.js("return document.activeElement.innerText") == "Keep rough.ply" and page.js(leaving)
        webdriver.ActionChains(page.driver).send_keys(key).perform()
        page.settle()
        assert page.js(lost) is None and page.one("h1").text == "rough.ply"

    # what is saved is not lost, but what is painted then
    page.press_button("Save…")
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", "Saved as")
    page.press_button("Close")
    assert not page.js(leaving)
    page.fill(".settings select", "laplacian")
    page.begun()
    assert page.js(leaving)
    take(page, "pin")
    page.drag((60, 0), (20, 0))
    page.begun()
    page.drop(tmp_path / "other.ply")
    assert page.js(lost) == "The paint and the result are not saved and will be lost."


@needs_browser
def test_another_mesh_is_opened_in_place_of_what_may_be_lost_or_is_saved(page, dropped, tmp_path):
    save_mesh(tmp_path / "other.ply", noisy(icosphere(2), 0.2))
    page.at(dropped).wait()
    page.drop(tmp_path / "other.ply")
    page.press_button("Open other.ply")
    page.said("h1", "other.ply")
    page.begun()

    # what is saved is not lost: another mesh is opened unasked
    page.press_button("Save…")
    page.press_button("Download")
    page.said(".saving [role=status]", "Downloaded as")
    page.press_button("Close")
    page.drop(dropped.folder / "rough.ply")
    assert not page.driver.find_elements("css selector", ".leaving[open]")
    page.said("h1", "rough.ply")
    page.begun()


@needs_browser
def test_the_files_that_are_replaced_are_named(page, named):
    page.at(named).wait()
    for tool, place in (("pin", -60), ("mask", 60)):
        take(page, tool)
        page.drag((place, 0), (0, 20))
        page.begun()
    page.press_button("Save…")
    page.fill("#saving-name", "mine.ply")
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", "Saved as mine.ply")
    page.fill("#saving-name", "mine.stl")
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", r"^mine_mask.npy and mine_fixed.npy exist already: choose another name")
    assert not (named.folder / "mine.stl").exists()
    before = (named.folder / "mine.ply").read_bytes()
    page.press_button("Replace mine_mask.npy and mine_fixed.npy")
    page.said(".saving [role=status]", "Saved as mine.stl")
    assert (named.folder / "mine.stl").exists() and (named.folder / "mine.ply").read_bytes() == before
    page.press_button("Close")


@needs_browser
def test_pinned_vertices_have_the_colour_of_the_legend_and_weights_another(page, named):
    page.at(named).wait()
    page.js("location.hash = 'mode=one&left=before&view=0,0,1,0,0,0,3.2&light=unlit'")
    page.settle()
    shown = {}
    for tool in ("mask", "pin"):
        take(page, tool)
        page.fill(".painting input[type=range][max='120']", "60")
        page.drag((0, 0))
        page.begun()
        picture = page.canvas()
        shown[tool] = picture[picture.shape[0] // 2 + 10, picture.shape[1] // 2 + 10]
    assert page.one(".legend").text.split() == ["Pinned", "Weight", "0", "%", "100", "%"]
    swatch = page.js("return getComputedStyle(document.querySelector('.legend i')).backgroundColor")
    assert np.abs(shown["pin"] - np.array(re.findall(r"\d+", swatch), int)).max() <= 2
    assert np.abs(shown["mask"] - 255 * color_map(signed=False)[0]).max() <= 2


@needs_browser
def test_paint_of_another_page_is_shown_and_nothing_is_saved_before_the_mesh_is_denoised_with_it(page, named):
    page.at(named).wait()
    save = page.one(".bar .primary")
    assert save.is_enabled() and not page.one(".painting button").is_displayed()
    codes = np.zeros(len(ROUGH.vertices), np.uint8)
    codes[:20] = 255
    named.done("/api/paint?page=another", codes.tobytes())
    page.said(".said", "Another page of this studio has changed the paint")
    assert not save.is_enabled() and page.one(".painting button").is_displayed()
    page.press_button("Denoise")
    page.begun()
    page.press_button("Save…")
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", "Saved as")
    page.press_button("Close")
    np.testing.assert_array_equal(np.load(named.folder / "rough_denoised_fixed.npy"), codes == 255)
    page.press_button("Undo")
    page.begun()
    assert not page.one(".painting button").is_displayed()
