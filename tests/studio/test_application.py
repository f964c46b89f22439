"""The studio answers the requests of its page, and refuses those that make no sense."""

import os
import sys
from contextlib import closing

import pytest
from scans import LAPLACIAN, scanned
from studios import Studio, until


@pytest.mark.parametrize("number", ["9" * 5000, "-1", "1.0", "x"])
def test_a_number_that_was_not_given_out_is_not_found(studio, number):
    assert studio.asked("GET", f"/api/scene/{number}")[0] == studio.asked("GET", f"/api/saved/{number}")[0] == 404
    status, answer = studio.asked("POST", f"/api/drop/{number}?name=a.ply", b"ply\n")
    assert status == 400 and "nothing was dropped" in answer["error"]


@pytest.mark.parametrize("path", ["/../page.py", "/%2e%2e/server.py", "/server.py", "/api/scene/..%2f1", "/etc/passwd"])
def test_no_other_file_is_served(studio, path):
    assert studio.asked("GET", path)[0] == 404


def test_what_is_too_large_is_refused_and_not_kept(studio):
    drop = studio.done("/api/drop")["drop"]
    status, answer = studio.asked("POST", f"/api/drop/{drop}?name=large.ply", bytes(600_000))
    assert status == 413 and "0.5 MB" in answer["error"] and "--max-size" in answer["error"]
    studio.done(f"/api/drop/{drop}?name=a.ply", bytes(300_000))  # two together
    assert studio.asked("POST", f"/api/drop/{drop}?name=b.ply", bytes(300_000))[0] == 413
    status, answer = studio.asked("POST", "/api/open", {"drop": drop, "names": ["large.ply"]})
    assert (status, answer["error"]) == (400, "large.ply was not received: drop it again")
    assert studio.asked("POST", "/api/recipe", b"[" * 2_000_000)[0] == 413
    assert studio.asked("POST", "/api/paint", bytes(100_000))[0] == 413


@pytest.mark.parametrize("body", [b"", b"[]", b"{", b"[" * 100_000, b'{"settings": 3}', b"\xff"], ids=repr)
def test_requests_that_make_no_sense_are_answered(studio, body):
    status, answer = studio.asked("POST", "/api/denoise", body)
    assert status == 400 and answer["error"]


@pytest.mark.parametrize("place", ["name", "settings"])
def test_half_of_a_surrogate_pair_is_refused(studio, place):
    asked = {"settings": LAPLACIAN, "name": "out.ply"}
    asked |= {"name": "\ud800.ply"} if place == "name" else {"settings": {"method": "\ud800"}}
    status, answer = studio.asked("POST", "/api/recipe", asked)
    assert status == 400 and "valid text" in answer["error"]
    status, answer = studio.asked("POST", f"/api/drop/{studio.done('/api/drop')['drop']}?name=%ED%A0%80.ply", b"ply")
    assert status != 500, answer


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux alone")
def test_a_file_whose_name_is_no_text_is_opened_and_its_command_is_shown(tmp_path):
    name = os.fsdecode(b"caf\xe9.ply")
    scanned(tmp_path / name)
    with closing(Studio(name, folder=tmp_path)) as studio, studio.told() as events:
        until(events, type="opened")
        done = studio.done("/api/recipe", {"settings": LAPLACIAN, "name": "out.ply"})
        assert "denoise" in done["command"] and "out.ply" in done["command"]
