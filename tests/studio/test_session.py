"""Pages share the open mesh, its paint and the running work, which newer requests replace."""

import os
import signal
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from scans import LAPLACIAN, ROUGH, settings
from shapes import icosphere, noisy
from studios import Studio, until

from cascadenorm.io.interop import save_mesh

BAD = {
    "text.ply": (b"this is a letter, not a mesh\n" * 9, "text.ply"),
    "empty.ply": (b"", "the file is empty"),
    "points.ply": (
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
        b"0 0 0\n",
        "no faces",
    ),
    "notes.docx": (b"PK\x03\x04 not a mesh", "not a supported mesh format"),
    "cut.ply": (b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n\0", "cut.ply"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_mesh_is_refused_with_a_reason_and_the_open_mesh_stays(studio, tmp_path, name):
    content, reason = BAD[name]
    (tmp_path / name).write_bytes(content)
    status, answer = studio.drop(tmp_path / name)
    assert status == 400 and reason in answer["error"] and "/" not in answer["error"].replace("glb/", "")
    with studio.told() as events:
        assert until(events, type="opened")["name"] == "scan.ply"


@pytest.fixture
def large(tmp_path):
    """A studio on a mesh that is large enough for a coarse preview."""
    save_mesh(tmp_path / "large.ply", noisy(icosphere(6), 0.2))
    with closing(Studio("large.ply", folder=tmp_path)) as started:
        yield started


@pytest.mark.slow  # 80,000 faces in a studio of its own; test_workbench.py has the previews without a server
def test_a_coarse_preview_comes_first(large):
    with large.told() as events:
        until(events, type="opened")

        # coarse, then whole
        large.done("/api/denoise", {"settings": LAPLACIAN, "ticket": "first"})
        coarse, whole = (until(events, ticket="first", type="shown") for _ in range(2))
        assert coarse["coarse"] and not whole["coarse"]
        few, many = (large.asked("GET", f"/api/scene/{one['scene']}")[1]["meshes"] for one in (coarse, whole))
        assert few[-1]["positions"]["shape"][0] < many[-1]["positions"]["shape"][0] / 2
        assert few[-1]["faces"] == many[-1]["faces"] == 81920

        # another strength only blends what is known, so that no coarse mesh comes before it
        large.done("/api/denoise", {"settings": {**LAPLACIAN, "controls": {"strength": "0.25"}}, "ticket": "weak"})
        assert not until(events, ticket="weak", type="shown")["coarse"]


SLOW = {"method": "bilateral-normal", "parameters": {"iterations": "1000000"}, "controls": {}}
"""Hours of work that reports its progress often."""


def worker_of(studio):
    """The process that works for a studio."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            parent = int(process.joinpath("stat").read_text().rpartition(")")[2].split()[1])
            command = process.joinpath("cmdline").read_text()
        except OSError:
            continue
        if parent == studio.process.pid and "spawn_main" in command:
            return int(process.name)
    raise AssertionError("there is no worker")


LINUX = pytest.mark.skipif(sys.platform != "linux", reason="finds the worker in /proc")


@LINUX
def test_newer_requests_end_older_ones_and_a_crash_ends_nothing_else(studio):
    with studio.told() as events:
        until(events, type="opened")

        # a newer one, and cancelling
        studio.done("/api/denoise", {"settings": SLOW, "ticket": "old"})
        until(events, ticket="old", type="progress")
        studio.done("/api/denoise", {"settings": settings(strength=0.75), "ticket": "new"})
        until(events, ticket="old", type="cancelled")
        until(events, ticket="new", type="shown", coarse=False)
        studio.done("/api/denoise", {"settings": SLOW, "ticket": "long"})
        told = until(events, ticket="long", type="progress")
        assert 0 <= told["fraction"] < 1
        studio.done("/api/cancel")
        until(events, ticket="long", type="cancelled")

        # a crash
        studio.done("/api/denoise", {"settings": SLOW, "ticket": "killed"})
        until(events, ticket="killed", type="progress")
        os.kill(worker_of(studio), signal.SIGKILL)
        error = until(events, ticket="killed", type="failed")["error"]
        assert "SIGKILL" in error and error.endswith("The next request starts another process.")
        studio.done("/api/denoise", {"settings": LAPLACIAN, "ticket": "again"})
        until(events, ticket="again", type="shown", coarse=False)

        # work that does not come to its end by itself
        studio.done("/api/denoise", {"settings": SLOW, "ticket": "stuck"})
        until(events, ticket="stuck", type="progress")
        os.kill(worker_of(studio), signal.SIGSTOP)
        studio.done("/api/denoise", {"settings": settings(strength=0.25), "ticket": "next"})
        until(events, ticket="stuck", type="cancelled")
        until(events, ticket="next", type="shown", coarse=False)


@LINUX
def test_the_last_page_is_closed_in_the_middle_of_work(own_studio):
    with own_studio.told() as events:
        until(events, type="opened")
        own_studio.done("/api/denoise", {"settings": SLOW, "ticket": "left"})
        until(events, ticket="left", type="progress")
        worker = worker_of(own_studio)
    assert own_studio.ended() == 0
    assert not Path(f"/proc/{worker}").exists()


def test_a_tab_that_was_discarded_finds_its_paint_again(studio):
    codes = np.zeros(len(ROUGH.vertices), np.uint8)
    codes[:10] = 255
    with studio.told(leaves=False) as events:
        until(events, type="opened")
        studio.done("/api/paint", codes.tobytes())
    assert studio.asked("GET", "/api/kept-paint")[1] == codes.tobytes()
    studio.done("/api/paint", bytes(len(ROUGH.vertices)))


def test_pages_are_told_which_of_them_has_changed_the_paint(studio):
    codes = np.zeros(len(ROUGH.vertices), np.uint8)
    with studio.told() as events:
        until(events, type="opened")
        for page, pinned in [("same", 0), ("first", 10), ("again", 10), ("second", 0)]:
            codes[:] = np.arange(len(codes)) < pinned
            studio.done(f"/api/paint?page={page}", codes.tobytes())
        assert [until(events, type="painted")["page"] for _ in range(2)] == ["first", "second"]
