"""The viewer of reports in a real browser, and that its bundle is what its sources give."""

import re
import shutil
import subprocess
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from browsers import needs_browser, webdriver
from PIL import Image
from report_pages import CLEAN, FACE_ON, ROUGH, ReportBrowser, same_pixels
from selenium.webdriver.common.keys import Keys
from shapes import grid, noisy

import cascadenorm as cn
from cascadenorm.api.api import denoise_file_with_meshes
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.reports import report_denoised

ROOT = Path(__file__).parents[2]
VIEWER = ROOT / "viewer"
NPM = shutil.which("npm")


@pytest.mark.skipif(NPM is None or not (VIEWER / "node_modules").is_dir(), reason="npm ci has not been run in viewer/")
def test_the_bundles_are_what_their_sources_give(tmp_path):
    subprocess.run(["npm", "run", "--silent", "check"], cwd=VIEWER, check=True)
    subprocess.run(["node", "build.mjs", str(tmp_path)], cwd=VIEWER, check=True)
    for name in ("reports/viewer.js", "studio/studio.js"):
        bundle = (ROOT / "cascadenorm" / name).read_bytes()
        assert bundle == (tmp_path / name).read_bytes(), "run `npm ci && npm run build` in viewer/"


def test_the_bundle_is_small_names_its_licences_and_does_not_end_its_element():
    bundle = (ROOT / "cascadenorm" / "reports" / "viewer.js").read_text(encoding="utf-8")
    assert len(bundle.encode()) < 1_000_000
    head = bundle[: bundle.index("*/")]
    assert head.count("Permission is hereby granted") == 2 and "three-mesh-bvh" in head
    assert "</script" not in bundle.lower() and "<!--" not in bundle


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    result = cn.denoise(ROUGH, method="laplacian")
    save_mesh(folder / "before.ply", ROUGH)
    save_mesh(folder / "after.ply", result)
    cn.report(folder / "r.html", folder / "before.ply", folder / "after.ply", truth=CLEAN)
    return folder / "r.html"


@needs_browser
def test_it_opens_without_complaint_and_asks_nothing_of_the_network(browser, report):
    browser.driver.get_log("browser"), browser.driver.get_log("performance")
    browser.open(report)
    browser.click(300, 300)
    assert browser.js("return document.getElementById('viewer').dataset.state") == "ready"
    assert [entry for entry in browser.driver.get_log("browser") if entry["level"] != "INFO"] == []
    asked = re.findall(r'"Network.requestWillBeSent".*?"url":"([^"]*)"', str(browser.driver.get_log("performance")))
    assert {url.partition(":")[0] for url in asked} <= {"file", "about", "data", "blob"}
    assert {url for url in asked if url.startswith("file")} <= {report.as_uri(), f"{report.as_uri()}#{FACE_ON}"}


@needs_browser
@pytest.mark.parametrize("dark", [False, True])
def test_the_mesh_is_drawn_where_it_is_and_not_beside(browser, report, dark):
    browser.sized(1200, 800, dark=dark)
    browser.open(report, f"mode=one&{FACE_ON}")
    picture = browser.canvas()
    height, width, _ = picture.shape
    background = picture[height // 2, 5]
    assert (np.abs(background - 242) < 4).all() if not dark else (background < 40).all()
    assert same_pixels(picture[-40:], background).mean() > 0.95
    middle = picture[height // 2 - 100 : height // 2 + 100, width // 2 - 100 : width // 2 + 100]
    assert not same_pixels(middle, background).any()
    assert len(np.unique(middle.reshape(-1, 3), axis=0)) > 50  # faces of many shades
    browser.sized(1200, 800)


@needs_browser
def test_the_split_changes_what_it_passes_over_and_nothing_else(browser, report):
    browser.open(report, f"mode=split&split=0.5&{FACE_ON}")
    first = browser.canvas()
    browser.open(report, f"mode=split&split=0.4&{FACE_ON}")
    second = browser.canvas()
    width = first.shape[1]
    differs = ~same_pixels(first, second)
    left, right = int(0.4 * width), int(0.5 * width)
    names = 45  # pixels at the top, where the names of the meshes are
    assert not differs[names:, : left - 20].any() and not differs[names:, right + 20 :].any()
    assert differs[:, left + 20 : right - 20].any(axis=0).mean() > 0.9
    alone = {}
    for name in ("before", "after"):
        browser.open(report, f"mode=one&left={name}&{FACE_ON}")
        alone[name] = browser.canvas()
    assert same_pixels(second, alone["before"])[names:, : left - 20].all()
    assert same_pixels(second, alone["after"])[names:, left + 20 :].all()


@needs_browser
def test_the_handle_of_the_split_is_dragged_and_moved_by_keys(browser, report):
    browser.open(report, f"mode=split&split=0.5&{FACE_ON}")
    handle = browser.one(".handle")
    width = browser.one(".stage").rect["width"]
    webdriver.ActionChains(browser.driver).drag_and_drop_by_offset(handle, int(-0.2 * width), 0).perform()
    assert float(browser.state()["split"]) == pytest.approx(0.3, abs=0.01)
    handle.send_keys("\ue014")  # arrow to the right
    assert float(browser.state()["split"]) == pytest.approx(0.32, abs=0.01)
    assert handle.get_attribute("aria-valuenow") == "32"
    view = browser.state()["view"]
    for keys, split in ((Keys.UP, 0.34), (Keys.DOWN * 2, 0.3), (Keys.END, 1), (Keys.HOME, 0)):
        handle.send_keys(keys)
        assert float(browser.state()["split"]) == pytest.approx(split, abs=0.01)
    assert browser.state()["view"] == view


@needs_browser
def test_figures_of_a_face_are_those_of_the_file(browser, report):
    browser.open(report, f"mode=one&left=after&{FACE_ON}")
    height, width, _ = browser.canvas().shape
    found = browser.click(width // 2 + 60, height // 2 - 40)
    before, after = (cn.read(report.parent / f"{name}.ply").mesh for name in ("before", "after"))
    face = int(found["After"].removeprefix("face "))
    number = lambda name: float(re.match(r"[-\d.e]+", found[name])[0])  # noqa: E731
    turned = np.degrees(np.arccos(before.face_normals[face] @ after.face_normals[face]))
    assert number("Angle to the input") == pytest.approx(turned, abs=0.1)
    angle = np.degrees(np.arccos(CLEAN.face_normals[face] @ after.face_normals[face]))
    assert number("Angle to the truth") == pytest.approx(angle, abs=0.1)
    moves = np.linalg.norm(after.vertices - before.vertices, axis=1)[after.faces[face]].mean()
    assert number("Displacement") == pytest.approx(moves, rel=0.02)
    assert number("Area") == pytest.approx(after.areas[face], rel=0.01)
    centroid = [float(value) for value in found["Centroid"].split(",")]
    np.testing.assert_allclose(centroid, after.centroids[face], atol=1e-3)


@needs_browser
def test_colors_of_the_heat_map_are_those_of_the_bar_at_the_value(browser, report):
    """Without light a face has exactly the colour of its value, which is also that of the bar there."""
    browser.open(report, f"mode=one&left=before&light=unlit&color=normal-error&{FACE_ON}")
    bar = browser.pixels(".bars")[-6]
    low, high = (float(text.rstrip("°")) for text in browser.one(".ticks").text.split()[::2])
    assert low == 0
    picture = browser.canvas()
    height, width, _ = picture.shape
    checked = set()
    for x in range(width // 2 - 140, width // 2 + 141, 7):
        y = height // 2 - 90 + (x % 5) * 40
        around = picture[y - 2 : y + 3, x - 2 : x + 3]
        if not same_pixels(around, picture[y, x]).all():
            continue  # an edge of a face
        if len(checked) == 6:
            break
        value = float(browser.click(x, y)["Angle to the truth"].rstrip("°"))
        place = min(value / high, 1) * (len(bar) - 1)
        assert np.abs(picture[y, x] - bar[round(place)]).max() <= 8, (value, picture[y, x], bar[round(place)])
        checked.add(round(place))
    assert len(checked) == 6


@needs_browser
def test_a_range_lights_up_its_faces_and_greys_the_others(browser, report):
    plain = f"mode=one&left=before&light=unlit&color=normal-error&{FACE_ON}"
    browser.open(report, plain)
    before = browser.canvas()
    browser.open(report, f"{plain}&range=20,1000")
    after = browser.canvas()
    height, width, _ = before.shape
    angles = np.degrees(np.arccos(np.clip((ROUGH.face_normals * CLEAN.face_normals).sum(axis=1), -1, 1)))
    seen = set()
    for x in range(width // 2 - 150, width // 2 + 151, 20):
        y = height // 2 + 30
        if not same_pixels(before[y - 2 : y + 3, x - 2 : x + 3], before[y, x]).all():
            continue
        face = int(browser.click(x, y)["Before"].removeprefix("face "))
        kept = same_pixels(before[y : y + 1, x : x + 1], after[y : y + 1, x : x + 1]).all()
        if abs(angles[face] - 20) > 0.1:
            assert kept == (angles[face] > 20), angles[face]
            seen.add(bool(kept))
        if not kept:
            assert np.ptp(after[y, x]) < 30  # nearly grey
    assert seen == {True, False}


@needs_browser
def test_a_range_is_picked_by_dragging_over_the_histogram_and_cleared(browser, report):
    browser.open(report, f"mode=one&color=normal-error&{FACE_ON}")
    bars = browser.one(".bars")
    browser.js("arguments[0].scrollIntoView({block: 'center'})", bars)
    width = bars.rect["width"]
    action = webdriver.ActionChains(browser.driver).move_to_element_with_offset(bars, int(-0.25 * width), 0)
    action.click_and_hold().move_by_offset(int(0.5 * width), 0).release().perform()
    high = float(browser.one(".ticks").text.split()[2].rstrip("°"))
    low, top = map(float, browser.state()["range"].split(","))
    assert low == pytest.approx(0.25 * high, rel=0.1) and top == pytest.approx(0.75 * high, rel=0.1)
    browser.one(".histogram button").click()
    assert "range" not in browser.state()


@needs_browser
def test_counts_in_the_histogram_are_logarithmic_unless_switched_off(browser, report):
    browser.open(report, f"mode=one&left=before&color=normal-error&{FACE_ON}")
    heights = "return [...document.querySelectorAll('.bars .bar')].map(e => Number(e.getAttribute('height')))"
    logarithmic = np.array(browser.js(heights))
    browser.one(".histogram input[type=checkbox]").click()
    linear = np.array(browser.js(heights))
    angles = np.degrees(np.arccos(np.clip((ROUGH.face_normals * CLEAN.face_normals).sum(axis=1), -1, 1)))
    high = float(browser.one(".ticks").text.split()[2].rstrip("°"))
    counts = np.histogram(np.minimum(angles, high * 0.9999), bins=len(linear), range=(0, high))[0]
    share = linear / linear.max()
    assert np.cumsum(share) / share.sum() == pytest.approx(np.cumsum(counts) / counts.sum(), abs=0.03)
    most = len(ROUGH.faces) / share.sum()
    assert logarithmic / logarithmic.max() == pytest.approx(np.log1p(share * most) / np.log1p(most), abs=0.06)


@needs_browser
def test_keys_turn_blink_and_change_the_mode_and_the_address_shows_it_again(browser, report):
    browser.open(report, f"mode=split&{FACE_ON}")
    browser.press("3")
    browser.press("s")
    browser.press("w")
    state = browser.state()
    assert (state["mode"], state["smooth"], state["wireframe"]) == ("side", "1", "1")
    browser.press("b")
    assert browser.state()["left"] == "after"
    browser.press("b")
    assert (browser.state()["left"], browser.state()["mode"]) == ("before", "one")
    browser.press("\ue014" * 3 + "+")
    state = browser.state()
    eye = np.array(list(map(float, state["view"].split(","))))
    assert eye[0] == pytest.approx(np.sin(-0.45), abs=0.01) and eye[6] == pytest.approx(3.2 / 1.2, rel=1e-3)
    browser.js("document.activeElement.blur()")  # a focused canvas has a frame
    picture = browser.canvas()
    browser.open(report, browser.js("return location.hash.slice(1)"))
    assert np.abs(browser.canvas() - picture).mean() < 0.5  # the address has five digits
    browser.open(report, f"mode=one&smooth=1&wireframe=1&{FACE_ON}")
    assert np.abs(browser.canvas() - picture).mean() > 5


@needs_browser
def test_another_axis_points_up_and_the_camera_turns_with_it(browser, report):
    browser.open(report, f"mode=one&{FACE_ON}")
    eyes = []
    for axis in ("z", "y"):
        browser.js("document.querySelector(`.panel input[value=${arguments[0]}]`).click()", axis)
        browser.settle()
        state = browser.state()
        assert state["up"] == axis
        eyes.append(list(map(float, state["view"].split(",")))[:3])
    np.testing.assert_allclose(eyes, [[0, -1, 0], [0, 0, 1]], atol=1e-4)
    browser.js("document.querySelector('.panel input[value=z]').click()")
    browser.press("\ue012\ue012")  # arrows turn around that axis
    x, y, z = list(map(float, browser.state()["view"].split(",")))[:3]
    assert abs(z) < 1e-4 and x == pytest.approx(np.sin(0.3), abs=1e-3) and y == pytest.approx(-np.cos(0.3), abs=1e-3)


@needs_browser
def test_bars_of_the_histogram_have_logarithmic_heights(browser, report):
    browser.open(report, f"mode=one&left=before&color=normal-error&{FACE_ON}")
    found = "return [...document.querySelectorAll('.bars .bar')].map(e => Number(e.getAttribute('height')))"
    heights = np.array(browser.js(found))
    high = float(browser.one(".ticks").text.split()[2].rstrip("°"))
    angles = np.degrees(np.arccos(np.clip((ROUGH.face_normals * CLEAN.face_normals).sum(axis=1), -1, 1)))
    counts = np.histogram(np.minimum(angles, high), len(heights), (0, high))[0]
    assert np.abs(heights / heights.max() - np.log1p(counts) / np.log1p(counts.max())).max() < 0.1
    assert browser.one(".histogram h3").text == "Angle to the truth (°)"


@needs_browser
def test_side_by_side_both_show_the_same_place(browser, report):
    browser.open(report, f"mode=side&light=unlit&left=before&right=before&{FACE_ON}")
    picture = browser.canvas()
    half = picture.shape[1] // 2
    assert same_pixels(picture[45:, :half], picture[45:, half : 2 * half]).mean() > 0.995


@needs_browser
def test_fingers_turn_the_mesh_come_nearer_and_pick_a_face(browser, report):
    browser.sized(390, 844)
    browser.open(report, f"mode=one&{FACE_ON}")
    box = browser.one("canvas").rect
    x, y = (box[at] + box[side] / 2 for at, side in (("x", "width"), ("y", "height")))

    def touch(kind, *places):
        points = [{"x": x + dx, "y": y + dy, "id": i} for i, (dx, dy) in enumerate(places)]
        browser.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def gesture(*moments):
        for kind, places in zip(("touchStart", *("touchMove",) * (len(moments) - 1)), moments, strict=True):
            touch(kind, *places)
        touch("touchEnd")
        browser.settle()
        return np.array(list(map(float, browser.state()["view"].split(","))))

    turned = gesture([(0, 0)], [(30, 0)], [(60, 0)])
    assert turned[0] < -0.2 and turned[6] == pytest.approx(3.2, rel=1e-3)
    nearer = gesture([(-20, 0), (20, 0)], [(-30, 0), (30, 0)], [(-60, 0), (60, 0)])
    assert nearer[6] < 2.5
    gesture([(0, 0)])
    assert browser.js("return document.querySelectorAll('.figures dt').length") > 3
    browser.sized(1200, 800)


@needs_browser
@pytest.mark.parametrize("size", [(1200, 800), (390, 844)])
def test_side_by_side_the_whole_mesh_is_seen(browser, report, size):
    browser.sized(*size)
    browser.open(report, "mode=split")
    browser.js("[...document.querySelectorAll('input[value=side]')][0].click()")  # as a user, from another mode
    browser.settle()
    clicked = browser.canvas()
    browser.open(report, "mode=side")
    picture = browser.canvas()
    browser.sized(1200, 800)
    assert same_pixels(picture, clicked).mean() > 0.99
    half = picture.shape[1] // 2
    for left in (0, half):
        pane = picture[45:-10, left + 10 : left + half - 10]  # without names and round corners
        drawn = ~same_pixels(pane, pane[-1, 2])
        assert drawn.mean() > 0.1
        for edge in (drawn[:, :2], drawn[:, -2:], drawn[:2], drawn[-2:]):
            assert not edge.any()


@needs_browser
def test_a_finding_is_flown_to(browser, tmp_path):
    far = CLEAN.vertices + np.array([5, 0, 0])
    mesh = Mesh(far, np.vstack([CLEAN.faces, CLEAN.faces[700]]))
    cn.report(tmp_path / "r.html", mesh)
    browser.open(tmp_path / "r.html")
    buttons = browser.driver.find_elements("css selector", "[data-place] button")
    next(button for button in buttons if button.text == f"face {len(CLEAN.faces)}").click()
    browser.settle()
    height, width, _ = browser.canvas().shape
    face = int(browser.click(width // 2, height // 2)["Mesh"].removeprefix("face "))
    assert face in (700, len(CLEAN.faces))
    eye = np.array(list(map(float, browser.state()["view"].split(","))))
    assert eye[:3] @ CLEAN.face_normals[700] > 0.99


@needs_browser
def test_on_a_phone_nothing_sticks_out(browser, report):
    browser.sized(390, 844)
    browser.open(report, f"mode=split&color=normal-error&{FACE_ON}")
    assert browser.js("return document.documentElement.scrollWidth") <= 390
    assert browser.one(".stage").rect["width"] > 340
    assert browser.one(".panel").rect["y"] >= browser.one(".stage").rect["y"] + browser.one(".stage").rect["height"] - 1
    browser.sized(1200, 800)


@needs_browser
def test_on_a_phone_settings_and_what_they_mean_are_read_without_scrolling_sideways(browser, tmp_path):
    save_mesh(tmp_path / "rough.ply", CLEAN)
    report_denoised(tmp_path / "r.html", denoise_file_with_meshes(tmp_path / "rough.ply", tmp_path / "out.ply"))
    browser.sized(390, 844)
    browser.open(tmp_path / "r.html")
    browser.js("document.querySelector('.prose').closest('details').open = true")  # all settings have their defaults
    assert browser.js("return document.querySelector('.prose').getBoundingClientRect().right") <= 390
    cells = "return [...document.querySelector('.prose tbody tr').children].map(e => [e.innerText, e.innerHTML])"
    name, value, default, meaning = browser.js(cells)
    assert [one[0] for one in (name, value, default)] == ["model", "none", "none"]
    assert meaning[1] == "Weights file written by <code>cascadenorm train</code>. Default: the shipped weights"
    browser.sized(1200, 800)


@needs_browser
def test_controls_have_names(browser, report):
    browser.open(report, f"color=normal-error&{FACE_ON}")
    nameless = browser.js(
        "return [...document.querySelectorAll('input, select, button, canvas, [role]')].filter(e => !("
        "e.ariaLabel || e.labels?.length || e.textContent.trim() || e.role === 'status')).map(e => e.outerHTML)"
    )
    assert nameless == []


@needs_browser
def test_without_webgl_picture_and_text_stay(report):
    with closing(ReportBrowser(webgl=False)) as browser:
        browser.open(report)
        assert browser.js("return document.getElementById('viewer').dataset.state") == "still"
        assert "WebGL 2" in browser.one("#viewer").text
        image = browser.one("#viewer svg")
        assert image.is_displayed() and image.rect["width"] > 1000
        assert "Findings" in browser.one("main").text


@needs_browser
@pytest.mark.slow  # a million faces
def test_a_million_faces_are_shown_whole_by_a_report(browser, tmp_path):
    plane = grid(707, 707)
    clean = plane.moved(plane.vertices + 30 * np.sin(plane.vertices[:, :1] / 40) * (0, 0, 1))
    cn.report(tmp_path / "r.html", noisy(clean, 0.2), clean)
    browser.open(tmp_path / "r.html")
    assert not browser.one(".decimated").is_displayed()


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
