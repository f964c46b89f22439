"""The studio's page in a real browser, from a dropped mesh to a saved file."""

import re
import shlex
from contextlib import closing

import numpy as np
import pytest
import studio_pages
from browsers import needs_browser, webdriver
from report_pages import same_pixels
from scans import ROUGH
from selenium.webdriver.common.keys import Keys
from shapes import grid, noisy
from studios import Studio

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.registry import FAMILIES, by_family


@needs_browser
def test_from_a_dropped_mesh_to_a_downloaded_file(page, empty_studio, tmp_path):
    save_mesh(tmp_path / "rough.ply", ROUGH)
    page.driver.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path)})
    page.driver.get_log("browser"), page.driver.get_log("performance")
    page.at(empty_studio).wait("empty")
    page.until(page.one(".zone").is_displayed, "a place to drop a mesh")
    page.drop(tmp_path / "rough.ply")
    page.wait()
    assert not page.one(".zone").is_displayed()
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
    page.until((tmp_path / "smooth.obj").exists, "the downloaded file")
    cn.denoise_file(tmp_path / "rough.ply", tmp_path / "same.obj", method="laplacian", strength=0.5)
    assert (tmp_path / "smooth.obj").read_bytes() == (tmp_path / "same.obj").read_bytes()

    # nothing went wrong, and nobody else was asked
    assert [entry for entry in page.driver.get_log("browser") if entry["level"] != "INFO"] == []
    asked = re.findall(r'"Network.requestWillBeSent".*?"url":"([^"]*)"', str(page.driver.get_log("performance")))
    assert asked and {url.split("/")[2] for url in asked if url.startswith("http")} == {empty_studio.host}
    assert {url.partition(":")[0] for url in asked} <= {"http", "about", "data", "blob"}


@needs_browser
def test_a_page_asks_for_no_mesh_but_the_given_one_goes_on_when_loaded_again_and_ends_the_studio(page, own_studio):
    watching = """
    new MutationObserver(() => {
      const zone = document.querySelector('.zone');
      if (zone && !zone.hidden) window.zoneWasShown = true;
    }).observe(document, {subtree: true, childList: true, attributes: true});
    """
    with page.starting_with(watching):
        page.at(own_studio).wait()
        assert page.js("return window.zoneWasShown") is None
        assert page.js("return location.hash").find("token") == -1
        page.js("window.onbeforeunload = null")
        page.driver.refresh()
        page.wait()  # the file is open already
        assert page.js("return window.zoneWasShown") is None
    page.driver.get("about:blank")
    assert own_studio.ended() == 0


@needs_browser
def test_a_result_is_saved_beside_the_file_and_copied_as_a_command(page, named, tmp_path):
    page.at(named).wait()
    page.press_button("Save…")
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", r"Saved as rough_denoised.ply\. All attributes")
    saved = (named.folder / "rough_denoised.ply").read_bytes()
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", "exists already")
    (named.folder / "rough_denoised.ply").write_bytes(b"")
    page.press_button("Replace rough_denoised.ply")
    page.said(".saving [role=status]", "Saved as")
    assert (named.folder / "rough_denoised.ply").read_bytes() == saved
    cn.denoise_file(named.folder / "rough.ply", tmp_path / "same.ply")
    assert (tmp_path / "same.ply").read_bytes() == saved
    page.press_button("Close")

    # the file is confirmed by its path and a link to what it holds
    (line,) = page.driver.find_elements("css selector", ".saved-files li")
    assert line.is_displayed() and line.text.startswith(str(named.folder / "rough_denoised.ply"))
    (tmp_path / "copies").mkdir()
    page.driver.execute_cdp_cmd(
        "Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path / "copies")}
    )
    line.find_element("css selector", "a").click()
    page.until((tmp_path / "copies" / "rough_denoised.ply").exists, "the copy")
    assert (tmp_path / "copies" / "rough_denoised.ply").read_bytes() == saved

    page.js("Object.defineProperty(navigator, 'clipboard', {value: undefined})")
    page.press_button("Copy as command line")
    command = shlex.split(page.said(".status code", "cascadenorm.*"))
    assert command == ["cascadenorm", "denoise", "rough.ply", "-o", "rough_denoised.ply", "--method", "auto"]
    assert "It reads" not in page.one(".said").text
    page.press_button("Copy as Python")
    page.said(".status code", r"cn\.denoise_file\('rough.ply', 'rough_denoised.ply', method='auto'\)")


@needs_browser
def test_the_kind_of_error_is_said_as_the_command_line_prints_it(page, named, tmp_path, capsys):
    page.at(named).wait()
    shown = page.js("return [...document.querySelectorAll('.found > *')].map(e => e.innerText)")
    assert run(["denoise", str(named.folder / "rough.ply"), "-o", str(tmp_path / "same.ply")]) == 0
    printed = dict(line.split(": ", 1) for line in capsys.readouterr().out.splitlines() if ": " in line)
    assert shown == ["Kind of error", printed["kind of error"], "Treated as", printed["treated as"]]
    page.fill(".settings select", "laplacian")
    page.begun()
    assert page.js("return document.querySelectorAll('.found > *').length") == 0


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
def test_a_scene_that_comes_after_another_mesh_was_opened_is_no_error(page, dropped, tmp_path):
    page.at(dropped).wait()
    page.js(
        "const before = window.fetch;"
        "window.fetch = async (path, ...rest) => {"
        "  if (/scene/.test(path) && !window.resume) await new Promise(resume => (window.resume = resume));"
        "  return before(path, ...rest).finally(() => (window.answered = path)); };"
    )
    for name in ("first.ply", "second.ply"):
        save_mesh(tmp_path / name, ROUGH)
    page.drop(tmp_path / "first.ply", replacing=True)
    page.until(lambda: page.js("return Boolean(window.resume)"), "the first scene")
    page.drop(tmp_path / "second.ply")
    page.begun()
    page.js("window.answered = ''; window.resume()")
    page.until(lambda: page.js("return window.answered"), "the answer to the first scene")
    page.settle()
    assert page.one("h1").text == "second.ply" and page.one(".failed").text == ""
    assert page.one(".said").text.startswith("Denoised in")


@needs_browser
def test_hidden_files_that_come_with_a_mesh_are_left_out(page, dropped, tmp_path):
    save_mesh(tmp_path / "other.ply", cn.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    (tmp_path / ".DS_Store").write_bytes(b"hidden")
    page.at(dropped).wait()
    page.drop(tmp_path / ".DS_Store", replacing=True)
    page.said(".failed", "'.DS_Store' is not a plain file name")
    page.drop(tmp_path / ".DS_Store", tmp_path / "other.ply")
    page.press_button("Open other.ply")
    page.begun()
    assert page.one("h1").text == "other.ply" and page.one(".counts").text == "1 face, 3 vertices"


HOLDING = """
const before = window.fetch;
window.held = ['/api/denoise'];
window.fetch = async (path, options) => {
  if (window.held.includes(path)) {
    window.ticket = JSON.parse(options.body).ticket ?? window.ticket;
    await new Promise(resume => (window.resume = resume));
  }
  const answer = await before(path, options);
  if (path !== '/api/events') return answer;
  const through = new TransformStream({start: (stream) => {
    window.tell = (told) => stream.enqueue(new TextEncoder().encode(`data: ${JSON.stringify(told)}\\n\\n`));
  }});
  return new Response(answer.body.pipeThrough(through));
};
"""
"""Holds requests back, and tells the page of events."""


@needs_browser
def test_what_is_said_of_cancelled_work_is_true_and_hides_no_file_that_is_being_opened(page, dropped, tmp_path):
    with page.starting_with(HOLDING):
        page.at(dropped)

    def cancelled():
        page.until(lambda: page.js("return window.ticket"), "a request")
        page.js("tell({type: 'cancelled', ticket: window.ticket}); window.ticket = ''")
        page.settle()

    cancelled()  # nothing but the input is shown
    assert page.one(".said").text == "Cancelled."
    page.press_button("Denoise")
    page.until(lambda: page.js("return window.ticket"), "a request")
    page.js("window.held = []; window.ticket = ''; window.resume()")
    page.wait()
    page.js("window.held = ['/api/denoise']")
    page.fill(".strength input[type=range]", "0.5")
    cancelled()
    assert page.one(".said").text == "Cancelled. The result shown was made with other settings."

    page.fill(".strength input[type=range]", "0.6")
    page.until(lambda: page.js("return window.ticket"), "a request")
    page.js("window.held = ['/api/open']")
    save_mesh(tmp_path / "other.ply", ROUGH)
    page.drop(tmp_path / "other.ply", replacing=True)
    page.said(".status", r"Opening other\.ply")
    cancelled()
    assert page.one(".status").text == "Opening other.ply…"
    page.js("window.held = []; window.resume()")
    page.begun()
    assert page.one("h1").text == "other.ply" and "Opening" not in page.one(".status").text


@needs_browser
def test_work_is_cancelled_and_started_again_by_the_same_key(page, named):
    with page.starting_with(HOLDING):
        page.at(named)
    page.until(lambda: page.js("return window.ticket"), "a request")
    page.button("Cancel").send_keys(Keys.ENTER)
    assert page.one(".said").text == "Cancelling…"
    scene = page.js("return performance.getEntriesByType('resource').map(e => e.name).find(e => e.includes('scene/'))")
    coarse = f"{{type: 'shown', coarse: true, scene: {scene.rpartition('/')[2]}}}"
    for event, value in (("{type: 'progress', fraction: 0.5, left: 9}", 0.5), (coarse, 0)):
        page.js(f"tell({{ticket: window.ticket, ...{event}}})")
        page.until(lambda value=value: page.js("return document.querySelector('progress').value") == value, "the event")
        assert page.one(".said").text == "Cancelling…"  # what comes meanwhile does not hide it
    page.js("tell({type: 'cancelled', ticket: window.ticket}); window.held = [];")
    page.settle()
    assert page.js("return document.activeElement.textContent") == "Denoise"
    page.driver.switch_to.active_element.send_keys(Keys.ENTER)
    page.wait()
    assert "Denoised in" in page.one(".said").text


@needs_browser
def test_the_panel_stays_as_it_is_when_a_result_comes(page, named):
    page.at(named).wait()
    page.js("location.hash = 'color=displacement&limits=0,0.2'")
    page.settle()
    heights = "return [...document.querySelectorAll('.bars .bar')].map(bar => bar.getAttribute('height'))"
    before = page.js(heights)
    page.one(".panel summary").click()
    page.one("[aria-label='Upper limit of the colours']").send_keys("5")
    page.js("document.querySelector('.panel').scrollTop = 120")
    page.fill(".strength input[type=range]", "0.5")
    page.begun()
    kept = "const p = document.querySelector('.panel'); return [p.scrollTop, p.querySelector('details').open]"
    assert page.js(kept) == [120, True]
    assert page.js("return document.activeElement.value") == "0.25"  # still being typed
    assert page.js(heights) != before


@needs_browser
@pytest.mark.parametrize(("mode", "shown"), [("Side by side", ["Before", "After"]), ("One", ["After"])])
def test_a_page_that_is_loaded_again_and_another_mesh_are_shown_in_the_same_mode(page, dropped, tmp_path, mode, shown):
    page.at(dropped).wait()
    next(one for one in page.driver.find_elements("css selector", ".panel label") if one.text == mode).click()
    page.address()
    page.js("window.onbeforeunload = null")
    page.driver.refresh()
    page.wait()
    assert [name.text for name in page.driver.find_elements("css selector", ".names span")] == shown
    save_mesh(tmp_path / "wide.ply", cn.Mesh(ROUGH.vertices * [3, 1, 1], ROUGH.faces))
    page.drop(tmp_path / "wide.ply", replacing=True)
    page.begun()
    assert [name.text for name in page.driver.find_elements("css selector", ".names span")] == shown
    picture = page.canvas()
    for pane in np.split(picture[45:-10, : picture.shape[1] // 2 * 2], len(shown), axis=1):  # each shows it whole
        drawn = ~same_pixels(pane, pane[-1, 12])
        assert drawn.any() and not drawn[:, [10, -10]].any()


@needs_browser
def test_a_saved_file_that_was_removed_cannot_be_copied_and_the_page_says_so(page, named):
    page.at(named).wait()
    page.press_button("Save…")
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", "Saved as")
    page.press_button("Close")
    (named.folder / "rough_denoised.ply").unlink()
    page.one(".saved-files a").click()
    page.said(".saved-files [role=status]", "rough_denoised.ply is no longer there: save the result again")
    assert page.one(".saved-files [role=status]").is_displayed()


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
def test_a_page_says_when_the_studio_has_ended(page, empty_studio, tmp_path):
    save_mesh(tmp_path / "one.ply", cn.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    page.at(empty_studio).wait("empty")
    page.drop(tmp_path / "one.ply")
    page.wait()
    assert page.one(".counts").text == "1 face, 3 vertices"
    empty_studio.close()
    page.wait("ended")
    assert page.one(".failed").text == "The studio has stopped. Start it again."


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
    assert weak[middle].mean() > strong[middle].mean() + 10  # the lighter, the less a vertex has moved


@needs_browser
def test_the_view_is_copied_as_a_command_that_says_what_it_reads(page, named, monkeypatch):
    page.at(named).wait()
    page.js("Object.defineProperty(navigator, 'clipboard', {value: undefined})")
    page.press_button("Copy view as command line")
    said = page.said(".panel [role=status]", "(?s)cascadenorm render.*")
    command, needs = said.split(" It reads ")
    assert needs == "rough_denoised.ply: save the result first."
    page.press_button("Save…")
    page.fill("#saving-name", "mine.ply ")  # a blank at the end is no part of it
    page.press_button("Save beside the input")
    page.said(".saving [role=status]", "Saved as mine.ply")
    page.press_button("Close")
    page.press_button("Copy view as command line")
    command = shlex.split(page.said(".panel [role=status]", "(?s)cascadenorm render.*"))
    assert command[:4] == ["cascadenorm", "render", "rough.ply", "mine.ply"]
    monkeypatch.chdir(named.folder)
    assert run(command[1:]) == 0 and (named.folder / "view.png").exists()


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
def test_a_wait_for_what_never_comes_ends_and_says_so(page, named, monkeypatch):
    page.at(named).wait()
    monkeypatch.setattr(studio_pages, "LONGEST_WAIT_S", 0.1)
    with pytest.raises(AssertionError, match="did not reach the state shown, with more than 1 answers"):
        page.begun()


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
    assert {"Open…", "Save…", "Strength", "Copy as Python", "Position of the split", "Reset view"} <= seen


@needs_browser
@pytest.mark.slow  # a million faces
def test_a_million_faces_are_shown_whole(page, tmp_path):
    plane = grid(707, 707)
    clean = plane.moved(plane.vertices + 30 * np.sin(plane.vertices[:, :1] / 40) * (0, 0, 1))
    save_mesh(tmp_path / "million.ply", noisy(clean, 0.2))
    with closing(Studio("million.ply", folder=tmp_path)) as studio:
        page.at(studio)
        page.until(lambda: page.js("return document.querySelector('#viewer canvas')"), "a canvas")
        page.until(lambda: not page.one(".decimated").is_displayed(), "the whole mesh, after the coarse preview")
        page.settle()
        picture = page.canvas()
        middle = picture[len(picture) // 2 - 50 :][:100, picture.shape[1] // 2 - 50 :][:, :100]
        assert len(np.unique(middle.reshape(-1, 3), axis=0)) > 50  # no blank canvas


@needs_browser
def test_a_folder_is_refused_as_such(page, dropped, tmp_path):
    (tmp_path / "scans").mkdir()
    page.at(dropped).wait()
    dragged = {"items": [], "files": [str(tmp_path / "scans")], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        page.driver.execute_cdp_cmd("Input.dispatchDragEvent", {"type": kind, "x": 600, "y": 400, "data": dragged})
    page.press_button("Open scans")
    said = page.said(".failed", "^scans .*")
    assert said == "scans cannot be read. If it is a folder, open the files in it."


@needs_browser
def test_a_file_that_cannot_be_opened_ends_denoising_which_can_be_started_again(page, named, tmp_path):
    page.at(named).wait()
    page.fill(".settings select", "bilateral-normal")
    page.begun()
    page.fill("#parameters-iterations", "1000000")  # hours
    page.until(lambda: page.js("return document.querySelector('progress').value > 0"), "progress")
    (tmp_path / "letter.ply").write_text("dear reader", encoding="utf-8")
    page.drop(tmp_path / "letter.ply", replacing=True)
    page.said(".failed", "letter.ply")
    again = page.one(".status > button")
    page.until(again.is_displayed, "a button")
    again.click()
    page.until(page.one("progress").is_displayed, "progress")
    assert not page.one(".failed").is_displayed()
