"""What the studio's page says of files that it cannot open, and what can be done then."""

from browsers import needs_browser


@needs_browser
def test_a_folder_is_refused_as_such(page, studio, tmp_path):
    (tmp_path / "scans").mkdir()
    page.at(studio).wait("empty")
    dragged = {"items": [], "files": [str(tmp_path / "scans")], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        page.driver.execute_cdp_cmd("Input.dispatchDragEvent", {"type": kind, "x": 600, "y": 400, "data": dragged})
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
