"""Watched folders: each file is taken once, when it has stopped changing."""

import signal
import time

import numpy as np
import pytest
from batches import BALL, done_so_far, job, lines, results, scans, wait_for, watching

from cascadenorm.batch.inputs import Job
from cascadenorm.batch.watching import SCAN, SCANNING, Watched
from cascadenorm.io.interop import save_mesh


@pytest.mark.slow  # two processes, as the next one, which watches a folder that is gone for a while
def test_a_watched_folder_gives_each_file_that_comes(place):
    """That a file is left alone while it still grows is a matter of clocks: `test_a_file_settles_…` has its own."""
    scans(place / "other", 2)
    (place / "in").mkdir()
    with watching("in", "-o", "in/out", "--watch", "0.2", "--workers", "1") as process:
        (place / "other" / "a" / "0.ply").rename(place / "in" / "scan.ply")
        wait_for(lambda: done_so_far(place / "in" / "out") == 1, process)
        (place / "other" / "b" / "0.ply").rename(place / "in" / "later.ply")
        wait_for(lambda: done_so_far(place / "in" / "out") == 2, process)
        process.send_signal(signal.SIGINT)
        assert process.wait() == 130
    assert not lines(place / "in" / "out", "failed")
    assert sorted(results(place / "in" / "out")) == ["later.ply", "scan.ply"]


def test_a_watch_goes_on_when_its_folder_is_gone_for_a_while_and_where_results_would_clash(place):
    scans(place / "other", 2)
    (place / "other" / "b" / "0.ply").rename(place / "later.ply")
    (place / "other" / "a").rename(place / "in")
    with watching("in", "-o", "out", "--format", "stl", "--watch", "0.5", "--workers", "1") as process:
        wait_for(lambda: done_so_far(place / "out") == 1, process)
        (place / "in").rename(place / "away")
        assert process.stderr.readline() == "cascadenorm: in: not there at present: the watch continues\n"
        save_mesh(place / "away" / "0.obj", BALL)
        (place / "later.ply").rename(place / "away" / "later.ply")
        time.sleep(1.5)
        (place / "away").rename(place / "in")
        wait_for(lambda: done_so_far(place / "out") == 2, process)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate()
    assert process.returncode == 130
    assert said.splitlines()[0].startswith("cascadenorm: in/0.ply and in/0.obj would both be written to out/0.stl: ")
    assert not lines(place / "out", "failed") and sorted(results(place / "out")) == ["0.stl", "later.stl"]


def test_a_file_settles_when_it_has_stopped_changing(monkeypatch):
    now, there = [0.0], list[Job]()
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    watched = Watched(lambda: there, 2.0, pytest.fail)

    def taken(at, *jobs):
        now[0], there[:] = at, jobs
        return watched.take(())

    assert taken(0.0, job(1)) == []
    assert taken(1.5, job(2)) == []
    assert taken(3.0, job(2)) == []
    assert taken(3.5, job(2)) == [job(2)]
    assert taken(4.5, job(2)) == []
    assert taken(9.0, job(3)) == [] and taken(10.0) == []
    assert taken(12.0, job(3)) == []  # it had gone
    assert taken(14.0, job(3)) == [job(3)]


def test_scans_are_as_far_apart_as_they_take_but_one_that_was_slow_once_delays_none(monkeypatch):
    now, scans = [0.0], []

    def find():
        scans.append(now[0])
        now[0] += {1: 5.0, 3: 0.1, 4: 0.1}.get(len(scans), 0.0)
        return []

    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    watched = Watched(find, 0.0, pytest.fail)
    while len(scans) < 6:
        watched.take(())
        now[0] += 0.125
    apart = np.diff(scans)
    np.testing.assert_allclose(apart[:2], [5.0 + SCAN, SCAN], atol=0.13)
    np.testing.assert_allclose(apart[2:4], [0.1 + SCAN, 0.1 + SCANNING * 0.1], atol=0.13)
