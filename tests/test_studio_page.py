"""The studio's page in a real browser, from a dropped mesh to a saved file."""

import re
import shlex
import time
from base64 import b64encode
from io import BytesIO

import numpy as np
import pytest
from browsers import Browser, needs_browser, webdriver
from selenium.webdriver.common.keys import Keys
from shapes import grid, icosphere, noisy
from studios import Studio

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.interop import save_mesh
from cascadenorm.registry import FAMILIES, by_family

ROUGH = noisy(icosphere(3), 0.2)
DROP = """
const data = new DataTransfer();
for (const [name, text] of arguments[0]) {
  data.items.add(new File([Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0))], name));
}
document.body.dispatchEvent(new DragEvent('drop', {dataTransfer: data, bubbles: true, cancelable: true}));
"""


PATIENCE = 600
"""Seconds after which a page that does not come to a state is given up; machines under load are slow."""


class Page(Browser):
    """A browser on the page of a studio."""

    answers = 0

    def at(self, studio):
        self.driver.get("about:blank")
        self.driver.get(studio.address)
        return self

    def wait(self, state="shown", *, more=False):
        """Wait until the page is in a state and has drawn it; with `more`, with another answer than the last."""
        end = time.monotonic() + PATIENCE
        found = (
            "const {state, answers} = document.getElementById('studio').dataset; return [state, Number(answers ?? 0)]"
        )
        while (told := self.js(found))[0] != state or (more and told[1] <= self.answers):
            assert time.monotonic() < end, (told, self.answers, self.one(".side").text)
            time.sleep(0.02)
        self.answers = told[1]
        self.settle()

    def begun(self):
        """Wait until the answer to a change is shown."""
        self.wait(more=True)

    def drop(self, *files, replacing=False):
        """Drop files; with `replacing`, agree that what is not saved is lost."""
        self.js(DROP, [[file.name, b64encode(file.read_bytes()).decode()] for file in files])
        if replacing:
            self.press_button(f"Open {files[0].name}")

    def fill(self, selector, value):
        """Change a field as a user does who leaves it then."""
        self.js(
            "const e = document.querySelector(arguments[0]); e.value = arguments[1];"
            "for (const kind of ['input', 'change']) e.dispatchEvent(new Event(kind, {bubbles: true}))",
            selector,
            value,
        )

    def press_button(self, text):
        buttons = self.driver.find_elements("css selector", "button")
        next(button for button in buttons if button.text == text and button.is_displayed()).click()
        self.settle()

    def said(self, selector, pattern):
        """Wait until a text is there."""
        end = time.monotonic() + PATIENCE
        text = "return document.querySelector(arguments[0]).innerText"
        while not (found := re.search(pattern, self.js(text, selector))):
            assert time.monotonic() < end, self.one("#studio").text
            time.sleep(0.02)
        return found[0]


@pytest.fixture(scope="module")
def page():
    opened = Page()
    yield opened
    opened.driver.quit()


@pytest.fixture
def studio(tmp_path):
    """A studio without a file."""
    started = Studio(folder=tmp_path)
    yield started
    started.close()


@pytest.fixture
def named(tmp_path):
    """A studio on a file."""
    save_mesh(tmp_path / "rough.ply", ROUGH)
    started = Studio("rough.ply", folder=tmp_path)
    yield started
    started.close()


@needs_browser
def test_from_a_dropped_mesh_to_a_downloaded_file(page, studio, tmp_path):
    save_mesh(tmp_path / "rough.ply", ROUGH)
    page.driver.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    page.driver.get_log("browser"), page.driver.get_log("performance")
    page.at(studio).wait("empty")
    page.drop(tmp_path / "rough.ply")
    page.wait()
    assert page.one("h1").text == "rough.ply" and "1,280 faces" in page.one(".counts").text
    by_default = page.canvas()

    # the answer to another method is shown on the right, and the input on the left stays
    page.fill(".settings select", "laplacian")
    page.begun()
    page.fill(".strength input[type=range]", "0.5")
    page.begun()
    picture = page.canvas()
    differs = (np.abs(picture - by_default) > 4).any(axis=2)
    middle = picture.shape[1] // 2
    assert not differs[45:, : middle - 20].any() and differs[:, middle + 20 :].mean() > 0.05

    # what is downloaded is what the library writes
    page.press_button("Save…")
    page.fill("#saving-name", "smooth.obj")
    page.press_button("Download")
    page.said(".saving [role=status]", "Downloaded as smooth.obj")
    while not (tmp_path / "smooth.obj").exists():
        time.sleep(0.05)
    cn.denoise_file(tmp_path / "rough.ply", tmp_path / "same.obj", method="laplacian", strength=0.5)
    assert (tmp_path / "smooth.obj").read_bytes() == (tmp_path / "same.obj").read_bytes()

    # nothing went wrong, and nobody else was asked
    assert [entry for entry in page.driver.get_log("browser") if entry["level"] != "INFO"] == []
    asked = re.findall(r'"Network.requestWillBeSent".*?"url":"([^"]*)"', str(page.driver.get_log("performance")))
    assert asked and {url.split("/")[2] for url in asked if url.startswith("http")} == {studio.host}
    assert {url.partition(":")[0] for url in asked} <= {"http", "about", "data", "blob"}


@needs_browser
def test_a_result_is_saved_beside_the_file_and_copied_as_a_command(page, named, tmp_path):
    page.at(named).wait()
    page.press_button("Save…")
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", r"Saved as rough_denoised.ply\. All attributes")
    saved = (tmp_path / "rough_denoised.ply").read_bytes()
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", "exists already")
    (tmp_path / "rough_denoised.ply").write_bytes(b"")
    page.press_button("Replace rough_denoised.ply")
    page.said(".saving [role=status]", "Saved as")
    assert (tmp_path / "rough_denoised.ply").read_bytes() == saved
    cn.denoise_file(tmp_path / "rough.ply", tmp_path / "same.ply")
    assert (tmp_path / "same.ply").read_bytes() == saved
    page.press_button("Close")

    page.js("Object.defineProperty(navigator, 'clipboard', {value: undefined})")
    page.press_button("Copy as command line")
    command = shlex.split(page.said(".status code", "cascadenorm.*"))
    assert command == ["cascadenorm", "denoise", "rough.ply", "-o", "rough_denoised.ply", "--method", "auto"]
    assert "It reads" not in page.one(".said").text
    page.press_button("Copy as Python")
    page.said(".status code", r"cn\.denoise_file\('rough.ply', 'rough_denoised.ply', method='auto'\)")


@needs_browser
def test_what_is_wrong_is_said_and_what_is_open_stays(page, named, tmp_path):
    page.at(named).wait()
    (tmp_path / "letter.ply").write_text("dear reader", encoding="utf-8")
    page.drop(tmp_path / "letter.ply", replacing=True)
    page.said(".failed", "letter.ply")
    assert page.one("h1").text == "rough.ply"
    page.fill(".strength input[type=number]", "-3")
    page.said(".failed", "“Strength” is -3; it must be at least 0")
    page.fill(".strength input[type=number]", "0.7")
    page.begun()
    assert not page.one(".failed").is_displayed()


def drag(page, start, *steps):
    """Press at a place of the canvas, in pixels from its middle, and drag along steps."""
    action = webdriver.ActionChains(page.driver, duration=60)
    action.move_to_element_with_offset(page.one("canvas"), *start).click_and_hold()
    for step in steps:
        action.move_by_offset(*step)
    action.release().perform()
    page.settle()


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


@needs_browser
def test_a_brush_reaches_what_lies_under_it_and_undo_takes_it_back(page, named, tmp_path, monkeypatch):
    page.at(named).wait()
    page.fill(".settings select", "laplacian")
    page.begun()
    page.js("location.hash = 'mode=one&left=before&view=0,0,1,0,0,0,3.2'")
    page.settle()
    plain = page.canvas()
    height = min(page.one("canvas").rect[side] for side in ("width", "height"))

    def take(tool):
        page.js("document.querySelector(`.painting input[value=${arguments[0]}]`).click()", tool)

    def saved():
        """The files that are saved, and which vertices are where they were."""
        page.press_button("Save…")
        page.fill("#saving-name", "out.ply")
        page.js("document.querySelector('.saving button[type=submit]').click()")
        page.said(".saving [role=status]", "Saved as")
        page.press_button("Close")
        files = {path.name: path.read_bytes() for path in tmp_path.glob("out*")}
        moved = cn.read(tmp_path / "out.ply").mesh.vertices != cn.read(tmp_path / "rough.ply").mesh.vertices
        for path in tmp_path.glob("out*"):
            path.unlink()
        return files, ~moved.any(axis=1)

    # one dab
    take("pin")
    page.fill(".painting input[type=range][max='120']", "60")
    drag(page, (0, 0))
    page.begun()
    pinned = page.canvas()
    assert (np.abs(pinned - plain)[len(plain) // 2] > 20).any()
    files, kept = saved()
    away = under_the_brush(60, height)
    assert set(files) == {"out.ply", "out_fixed.npy"} and kept.sum() > 5
    assert kept[away < 0.98].all() and not kept[away > 1.02].any()

    # half of the displacement along a stroke, and its command
    take("mask")
    page.fill(".painting input[type=range][max='100']", "50")
    drag(page, (-80, 100), (80, 0), (80, 0))
    page.begun()
    files, kept = saved()
    weights = np.load(BytesIO(files["out_mask.npy"]))
    assert set(np.unique(weights)) == {0.5, 1.0} and 10 < (weights == 0.5).sum() < 300
    for name in ("out_fixed.npy", "out_mask.npy"):
        (tmp_path / name).write_bytes(files[name])
    page.js("Object.defineProperty(navigator, 'clipboard', {value: undefined})")
    page.press_button("Copy as command line")
    command = shlex.split(page.said(".status code", "cascadenorm.*"))
    assert {"out_mask.npy", "out_fixed.npy"} < set(command)
    page.said(".said", "It reads out_mask.npy and out_fixed.npy: save the result first")
    monkeypatch.chdir(tmp_path)
    assert run(command[1:]) == 0
    assert (tmp_path / "out.ply").read_bytes() == files["out.ply"]
    for path in tmp_path.glob("out*"):
        path.unlink()

    # beside the mesh it turns
    view = page.js("return location.hash")
    drag(page, (-250, -300), (60, 0))
    time.sleep(0.4)
    assert page.js("return location.hash") != view

    # back, step by step, and forth again
    page.press_button("Undo")
    page.begun()
    assert set(saved()[0]) == {"out.ply", "out_fixed.npy"}
    page.one("body").send_keys(Keys.CONTROL, "z")
    page.begun()
    files, kept = saved()
    assert set(files) == {"out.ply"} and not kept.any()
    page.press_button("Redo")
    page.begun()
    assert set(saved()[0]) == {"out.ply", "out_fixed.npy"}


@needs_browser
def test_a_page_that_is_loaded_again_has_no_paint_and_neither_has_its_result(page, named):
    page.at(named).wait()
    page.js("document.querySelector('.painting input[value=pin]').click()")
    drag(page, (60, 0), (20, 0))
    page.begun()
    moved = f"{len(ROUGH.vertices)} vertices moved"
    assert moved not in page.one(".said").text
    page.at(named).wait()
    assert not page.one(".painting > button").is_displayed() and moved in page.one(".said").text


@needs_browser
@pytest.mark.parametrize("level", [4, 2])
def test_another_mesh_is_opened_after_painting_without_the_paint(page, named, tmp_path, level):
    save_mesh(tmp_path / "other.ply", noisy(icosphere(level), 0.2))
    page.at(named).wait()
    page.js("document.querySelector('.painting input[value=pin]').click()")
    drag(page, (60, 0), (20, 0))
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
    page.at(named).wait()
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
    page.js("document.querySelector('.painting input[value=pin]').click()")
    drag(page, (60, 0), (20, 0))
    page.begun()
    page.drop(tmp_path / "other.ply")
    assert page.js(lost) == "The paint and the result are not saved and will be lost."
    page.press_button("Open other.ply")
    page.said("h1", "other.ply")
    page.begun()

    # saved again: another mesh is opened unasked
    page.press_button("Save…")
    page.press_button("Download")
    page.said(".saving [role=status]", "Downloaded as")
    page.press_button("Close")
    page.drop(tmp_path / "rough.ply")
    assert page.js(lost) is None
    page.said("h1", "rough.ply")
    page.begun()


@needs_browser
def test_the_files_that_are_replaced_are_named(page, named, tmp_path):
    page.at(named).wait()
    for tool, place in (("pin", -60), ("mask", 60)):
        page.js("document.querySelector(`.painting input[value=${arguments[0]}]`).click()", tool)
        drag(page, (place, 0), (0, 20))
        page.begun()
    page.press_button("Save…")
    page.fill("#saving-name", "mine.ply")
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", "Saved as mine.ply")
    page.fill("#saving-name", "mine.stl")
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", r"^mine_mask.npy and mine_fixed.npy exist already: choose another name")
    assert not (tmp_path / "mine.stl").exists()
    before = (tmp_path / "mine.ply").read_bytes()
    page.press_button("Replace mine_mask.npy and mine_fixed.npy")
    page.said(".saving [role=status]", "Saved as mine.stl")
    assert (tmp_path / "mine.stl").exists() and (tmp_path / "mine.ply").read_bytes() == before
    page.press_button("Close")


@needs_browser
@pytest.mark.parametrize("size", [(1300, 850), (390, 844)], ids=["desk", "phone"])
def test_an_error_is_in_view_and_its_field_is_marked(page, named, size):
    page.sized(*size)
    page.at(named).wait()
    page.js("document.querySelectorAll('details').forEach(one => one.open = true)")
    fields = {".strength input[type=number]": "-3", "#controls-creases": "abc"}
    for selector, value in fields.items():
        page.js("document.querySelector(arguments[0]).scrollIntoView({block: 'end'})", selector)
        page.fill(selector, value)
        page.said(".failed", "“Strength” is -3" if value == "-3" else "abc")
        for part in (".failed", selector):  # nothing lies over it, and it is on the screen
            assert page.js(
                "const e = document.querySelector(arguments[0]), b = e.getBoundingClientRect();"
                "const at = part => document.elementFromPoint(b.x + b.width / 2, b.y + part * b.height);"
                "return [0.1, 0.5, 0.9].every(part => e.contains(at(part)))",
                part,
            )
        marked = "return [...document.querySelectorAll('[aria-invalid=true]')].map(e => e.name)"
        assert page.js(marked) == [page.one(selector).get_attribute("name")]
        page.fill(selector, "")
        page.begun()
        assert page.js(marked) == []
    page.sized(1200, 800)


@needs_browser
def test_pinned_vertices_have_the_colour_of_the_legend_and_weights_another(page, named):
    page.at(named).wait()
    page.js("location.hash = 'mode=one&left=before&view=0,0,1,0,0,0,3.2&light=unlit'")
    page.settle()
    shown = {}
    for tool in ("mask", "pin"):
        page.js("document.querySelector(`.painting input[value=${arguments[0]}]`).click()", tool)
        page.fill(".painting input[type=range][max='120']", "60")
        drag(page, (0, 0))
        page.begun()
        picture = page.canvas()
        shown[tool] = picture[picture.shape[0] // 2 + 10, picture.shape[1] // 2 + 10]
    assert page.one(".legend").text.split() == ["Pinned", "Weight", "0", "%", "100", "%"]
    swatch = page.js("return getComputedStyle(document.querySelector('.legend i')).backgroundColor")
    assert np.abs(shown["pin"] - np.array(re.findall(r"\d+", swatch), int)).max() <= 2
    assert np.abs(shown["mask"] - [68, 1, 84]).max() <= 2  # viridis at 0


@needs_browser
def test_the_address_without_its_token_opens_nothing(page, named):
    page.driver.get("about:blank")
    page.driver.execute_cdp_cmd("Storage.clearDataForOrigin", {"origin": f"http://{named.host}", "storageTypes": "all"})
    page.driver.switch_to.new_window("tab")
    page.driver.get(f"http://{named.host}/")
    page.wait("ended")
    assert "token" in page.one(".ended").text
    page.driver.get(f"http://{named.host}/#token=wrong")
    page.driver.refresh()
    page.wait("ended")
    assert "the token is wrong" in page.one(".ended").text
    page.driver.close()
    page.driver.switch_to.window(page.driver.window_handles[0])


@needs_browser
def test_a_page_that_is_loaded_again_goes_on_and_one_that_is_closed_ends_the_studio(page, named):
    page.at(named).wait()
    assert page.js("return location.hash").find("token") == -1
    page.js("window.onbeforeunload = null")
    page.driver.refresh()
    page.wait()
    page.driver.get("about:blank")
    assert named.ended(20) == 0


@needs_browser
def test_a_page_says_when_the_studio_has_ended(page, studio, tmp_path):
    save_mesh(tmp_path / "one.ply", cn.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    page.at(studio).wait("empty")
    page.drop(tmp_path / "one.ply")
    page.wait()
    assert page.one(".counts").text == "1 face, 3 vertices"
    studio.close()
    page.wait("ended")
    assert page.one(".failed").text == "The studio has ended: start it again."


@needs_browser
@pytest.mark.parametrize("dark", [False, True])
def test_nothing_sticks_out_on_a_phone_and_controls_have_names(page, named, dark):
    page.sized(390, 844, dark=dark)
    page.at(named).wait()
    assert page.js("return document.documentElement.scrollWidth") <= 390
    stage, side, panel = (page.one(part).rect["y"] for part in (".stage", ".side", ".panel"))
    assert stage < side < panel
    nameless = page.js(
        "return [...document.querySelectorAll('input:not([type=file]), select, button, canvas, progress, [role]')]"
        ".filter(e => e.checkVisibility() && "
        "!(e.ariaLabel || e.labels?.length || e.textContent.trim() || ['status', 'alert'].includes(e.role)))"
        ".map(e => e.outerHTML)"
    )
    assert nameless == []
    page.sized(1200, 800)


@needs_browser
def test_methods_are_listed_by_family_and_said_in_plain_words(page, named):
    page.at(named).wait()
    listed = page.js(
        "return [...document.querySelectorAll('.settings > label option')]"
        ".map(e => [e.parentElement.label ?? '', e.value, e.textContent])"
    )
    assert listed[0] == ["", "auto", "auto (recommended)"]
    assert [name for _, name, _ in listed[1:]] == [
        method.name for members in by_family().values() for method in members if method.name != "auto"
    ]
    assert {group for group, *_ in listed[1:]} == {family.title for family in by_family()}
    page.fill(".settings select", "taubin")
    page.begun()
    assert page.one(".about").text == FAMILIES["smoothing"].about
    assert "Taubin 1995" in page.one(".settings .note").text


@needs_browser
def test_colours_are_those_of_the_last_result_and_a_face_stays_picked(page, named):
    page.at(named).wait()
    page.fill(".settings select", "laplacian")
    page.begun()
    page.js("location.hash = 'mode=one&left=before&light=unlit&color=displacement&limits=0,0.2&view=0,0,1,0,0,0,3.2'")
    page.settle()
    webdriver.ActionChains(page.driver).move_to_element(page.one("canvas")).click().perform()
    page.settle()

    def displacement():
        shown = dict(zip(*(page.js(f"return [...document.querySelectorAll('.figures {e}')].map(e => e.innerText)")
                           for e in ("dt", "dd")), strict=True))  # fmt: skip
        return shown["Before"], float(shown["Displacement"].split()[0])

    face, moved = displacement()
    strong = page.canvas()
    page.fill(".strength input[type=range]", "0.25")
    page.begun()
    assert displacement() == (face, pytest.approx(moved / 4, rel=0.05))
    weak = page.canvas()
    middle = np.s_[len(weak) // 2 - 60 : len(weak) // 2 + 60, weak.shape[1] // 2 - 60 : weak.shape[1] // 2 + 60]
    assert weak[middle].mean() < strong[middle].mean() - 10  # viridis is the darker, the less a vertex has moved


@needs_browser
def test_the_view_is_copied_as_a_command_that_says_what_it_reads(page, named, tmp_path, monkeypatch):
    page.at(named).wait()
    page.js("Object.defineProperty(navigator, 'clipboard', {value: undefined})")
    page.press_button("Copy view as command line")
    said = page.said(".panel [role=status]", "(?s)cascadenorm render.*")
    command, needs = said.split(" It reads ")
    assert needs == "rough_denoised.ply: save the result first."
    page.press_button("Save…")
    page.fill("#saving-name", "mine.ply")
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", "Saved as mine.ply")
    page.press_button("Close")
    page.press_button("Copy view as command line")
    command = shlex.split(page.said(".panel [role=status]", "(?s)cascadenorm render.*"))
    assert command[:4] == ["cascadenorm", "render", "rough.ply", "mine.ply"]
    monkeypatch.chdir(tmp_path)
    assert run(command[1:]) == 0 and (tmp_path / "view.png").exists()


@needs_browser
def test_on_a_phone_the_page_is_as_wide_as_the_phone_and_its_head_is_low(page, named):
    page.sized(390, 844)
    try:
        page.at(named).wait()
        assert page.js("return document.documentElement.scrollWidth") <= 390
        assert page.one("h1").rect["height"] < 40 and page.one(".bar").rect["height"] < 110
        assert page.one(".stage").rect["width"] > 380
    finally:
        page.sized(1200, 800)


@needs_browser
def test_controls_of_the_studio_have_names_and_are_reached_by_keys(page, named):
    page.at(named).wait()
    nameless = page.js(
        "return [...document.querySelectorAll('input, select, button, progress, canvas, dialog, [role]')].filter(e => !"
        "(e.ariaLabel || e.labels?.length || e.textContent.trim() || e.getAttribute('aria-labelledby')"
        " || ['status', 'alert'].includes(e.role))).map(e => e.outerHTML)"
    )
    assert nameless == []
    seen = set()
    for _ in range(60):
        webdriver.ActionChains(page.driver).send_keys(Keys.TAB).perform()
        seen.add(page.js("const e = document.activeElement; return e.textContent || e.ariaLabel || e.name || e.type"))
    assert {"Open…", "Save…", "Strength", "Copy as Python", "Place of the split", "Whole mesh"} <= seen


@needs_browser
@pytest.mark.slow  # a million faces
def test_a_million_faces_are_shown_whole(page, tmp_path):
    plane = grid(707, 707)
    clean = plane.moved(plane.vertices + 30 * np.sin(plane.vertices[:, :1] / 40) * (0, 0, 1))
    save_mesh(tmp_path / "million.ply", noisy(clean, 0.2))
    studio = Studio("million.ply", folder=tmp_path)
    try:
        page.at(studio)
        while not page.js("return document.querySelector('#viewer canvas')"):
            time.sleep(0.02)
        page.settle()
        assert not page.one(".decimated").is_displayed()
        picture = page.canvas()
        middle = picture[len(picture) // 2 - 50 :][:100, picture.shape[1] // 2 - 50 :][:, :100]
        assert len(np.unique(middle.reshape(-1, 3), axis=0)) > 50  # no blank canvas
    finally:
        studio.close()
