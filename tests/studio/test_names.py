"""Names of files are plain, and settings have the names that the form shows."""

import sys

import pytest
from scans import LAPLACIAN, scanned, settings
from studios import until


@pytest.mark.parametrize("name", ["../out.ply", "/tmp/out.ply", "a/b.ply", "..", ".out.ply", "a\\b.ply", "", None, 7])
def test_results_are_saved_beside_the_file_alone(studio, name):
    before = sorted(studio.folder.parent.rglob("*"))
    for path in ("/api/save", "/api/download", "/api/recipe"):
        status, answer = studio.asked("POST", path, {"settings": LAPLACIAN, "name": name})
        assert status == 400 and "plain file name" in answer["error"]
    assert sorted(studio.folder.parent.rglob("*")) == before


WINDOWS = pytest.mark.skipif(sys.platform != "win32", reason="a drive only on Windows")


@pytest.mark.parametrize(
    "name",
    ["../evil.ply", "%2Fetc%2Fpasswd", "..%2F..%2Fevil.ply", "a%00.ply", pytest.param("c:evil.ply", marks=WINDOWS)],
)
def test_dropped_files_have_plain_names(studio, name):
    drop = studio.done("/api/drop")["drop"]
    status, answer = studio.asked("POST", f"/api/drop/{drop}?name={name}", b"ply\n")
    assert status == 400 and "plain file name" in answer["error"]
    status, answer = studio.asked("POST", "/api/open", {"drop": drop, "names": ["../../scan.ply"]})
    assert status == 400 and "plain file name" in answer["error"]


def test_what_is_out_of_range_is_said_in_the_words_of_the_form(studio):
    with studio.told() as events:
        studio.done("/api/denoise", {"settings": settings(strength=-1), "ticket": "bad"})
        failed = until(events, ticket="bad", type="failed")
        assert "“Strength” is -1; it must be at least 0" in failed["error"]
        studio.done("/api/denoise", {"settings": {"method": "magic"}, "ticket": "none"})
        assert "there is no method 'magic'" in until(events, ticket="none", type="failed")["error"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such file names")
def test_a_file_with_the_time_in_its_name_is_opened_and_saved(studio, drop_studio, tmp_path):
    scanned(tmp_path / "scan 10:30?.ply")
    assert drop_studio.drop(tmp_path / "scan 10:30?.ply")[0] == 200
    with drop_studio.told() as events:
        name = until(events, type="opened")["suggested"]
    assert name == "scan 10:30?_denoised.ply"
    studio.done("/api/save", {"settings": LAPLACIAN, "name": name})
    (studio.folder / name).unlink()
