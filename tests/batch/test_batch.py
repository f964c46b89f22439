"""Many files: each once, whatever fails, is killed or comes later."""

import atexit
import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.batch.batch import denoise_files
from cascadenorm.batch.inputs import Job, find_jobs
from cascadenorm.batch.manifest import Manifest
from cascadenorm.batch.processes import LocalProcesses
from cascadenorm.batch.scheduling import Place, Schedule, needed
from cascadenorm.batch.settings import settings_of
from cascadenorm.batch.watching import SCAN, SCANNING, Settled, Watched
from cascadenorm.batch.work import Outcome, Task, work
from cascadenorm.cli import run
from cascadenorm.errors import OutputError, ParameterError, ReadError, WorkerError
from cascadenorm.execution.memory import PROCESS
from cascadenorm.execution.worker_processes import Worker, do_jobs, first_ready
from cascadenorm.io.atomic import remove_unfinished, unfinished_name
from cascadenorm.io.digests import file_digest
from cascadenorm.io.interop import save_mesh
from cascadenorm.registry import find

BALL = icosphere(2)
FAST = ["--method", "laplacian"]
START = """
import signal
from cascadenorm.cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background of a shell it is ignored
main()
"""
COMMAND = [sys.executable, "-c", START, "batch"]


def scans(folder: Path, count: int, **options) -> None:
    """Write noisy balls, alternately into two folders."""
    for number in range(count):
        place = folder / "ab"[number % 2] / f"{number // 2}.ply"
        place.parent.mkdir(parents=True, exist_ok=True)
        save_mesh(place, noisy(BALL, 0.2, seed=number), **options)


def lines(folder: Path, status: str) -> list[dict]:
    """The lines of a manifest with that status."""
    found = map(json.loads, (folder / "manifest.jsonl").read_text(encoding="utf-8").splitlines())
    return [line for line in found if line["status"] == status]


def results(folder: Path) -> dict[str, bytes]:
    """The content of every file below a folder but the manifest."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != "manifest.jsonl"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


# whole batches


def test_what_is_done_is_kept_and_what_changed_is_done_again(place, capsys):
    scans(place / "scans", 4)
    (place / "scans" / "a" / "bad.ply").write_text("ply\nno more", encoding="ascii")
    words = ["batch", "scans/**/*.ply", "-o", "out", *FAST, "--workers", "1"]
    assert run(words) == 6
    out, err = capsys.readouterr()
    assert "4 files denoised" in out and "1 file failed" in out
    assert err.startswith("cascadenorm: scans/a/bad.ply: ") and err.count("\n") == 1
    assert sorted(results(place / "out")) == ["a/0.ply", "a/1.ply", "b/0.ply", "b/1.ply"]
    cn.denoise_file("scans/b/1.ply", "alone.ply", method="laplacian")
    assert (place / "out" / "b" / "1.ply").read_bytes() == (place / "alone.ply").read_bytes()
    (failed,) = lines(place / "out", "failed")
    assert failed["error"]["type"] == "ReadError" and failed["attempts"] == 1
    assert failed["input_sha256"] == file_digest(place / "scans" / "a" / "bad.ply")
    done = {line["output"]: line for line in lines(place / "out", "done")}
    assert done["b/1.ply"]["summary"]["faces"] == 320 and len(done) == 4

    (place / "scans" / "a" / "bad.ply").unlink()
    save_mesh(place / "scans" / "a" / "0.ply", noisy(BALL, 0.1), force=True)
    (place / "out" / "b" / "0.ply").unlink()
    assert run([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert sorted(found["kept"]) == ["scans/a/1.ply", "scans/b/1.ply"]
    assert sorted(line["output"] for line in found["files"]) == ["a/0.ply", "b/0.ply"]

    before = (place / "out" / "a" / "1.ply").read_bytes()
    save_mesh(place / "out" / "b" / "1.ply", BALL, force=True)  # of somebody else
    done = denoise_files("scans/**/*.ply", "out", method="taubin", workers=1)
    assert len(done.lines) == 4 and (place / "out" / "a" / "1.ply").read_bytes() != before
    (failure,) = done.failures
    assert failure.source == "scans/b/1.ply" and failure.error.remedy == ("force", True)
    assert lines(place / "out", "failed")[-1]["output"] == "b/1.ply"
    assert [line["output"] for line in lines(place / "out", "started")].count("b/1.ply") == 1
    np.testing.assert_array_equal(cn.read("out/b/1.ply").mesh.vertices, BALL.vertices)


def children(pid: int) -> list[int]:
    """Processes that a process has started and that still run."""
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()]


def running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").split()[2] != "Z"
    except OSError:
        return False


def wait_for(condition, process: subprocess.Popen | None = None) -> None:
    """Wait until something has come about, however long that takes; fail where the process ends without it."""
    while not condition():
        assert process is None or process.poll() is None or condition(), "the process has ended before"
        time.sleep(0.02)


def done_so_far(folder: Path) -> int:
    path = folder / "manifest.jsonl"
    return path.read_bytes().count(b'"status": "done"') if path.exists() else 0


LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="it reads /proc")


def at_done(count: int, action: str) -> list[str]:
    """The start of a command line whose process does something when so many files are done.

    It is done in the process of the batch, between two files: no test has to be quick enough to see that moment.
    """
    code = f"""
import multiprocessing, os
from cascadenorm.batch.manifest import Manifest
add, done = Manifest.add, []

def add_and_act(self, line):
    add(self, line)
    done.extend([line] * (line["status"] == "done"))
    if line["status"] == "done" and len(done) == {count}:
        workers = multiprocessing.active_children()
        print(*(worker.pid for worker in workers), flush=True)
        {action}

Manifest.add = add_and_act
"""
    return [sys.executable, "-c", code + START, "batch"]


@LINUX
def test_a_batch_that_is_killed_goes_on_and_does_nothing_twice(place):
    scans(place / "scans", 60)
    words = ["scans", *FAST, "--workers", "2", "-o"]
    kill = at_done(10, "os.kill(os.getpid(), signal.SIGKILL)")
    done = subprocess.run([*kill, *words, "out"], stdout=subprocess.PIPE, text=True)
    assert done.returncode == -signal.SIGKILL
    workers = [int(word) for word in done.stdout.split()]
    assert len(workers) == 2
    wait_for(lambda: not any(map(running, workers)))
    finished = {line["output"] for line in lines(place / "out", "done")}
    assert len(finished) == 10
    assert not list((place / "out").rglob(".*"))
    subprocess.run([*COMMAND, *words, "out"], check=True)
    done = [line["output"] for line in lines(place / "out", "done")]
    assert len(done) == len(set(done)) == 60
    subprocess.run([*COMMAND, *words, "whole"], check=True)
    assert results(place / "out") == results(place / "whole")


@LINUX
def test_a_file_whose_process_is_killed_is_tried_again(place):
    scans(place / "scans", 60)
    kill = at_done(6, "[worker.kill() for worker in workers]")
    done = subprocess.run([*kill, "scans", *FAST, "--workers", "2", "-o", "out"], stdout=subprocess.PIPE, text=True)
    assert done.returncode == 0 and len(done.stdout.splitlines()[0].split()) == 2
    done = lines(place / "out", "done")
    attempts = [line["attempts"] for line in done]
    assert len(done) == 60 and set(attempts) == {1, 2} and attempts.count(2) <= 2


def test_a_process_that_works_too_long_is_stopped_and_its_file_is_denoised_later(place, capsys):
    scans(place / "scans", 2)
    words = ["batch", "scans", "-o", "out", *FAST, "--workers", "1"]
    assert run([*words, "--timeout", "0.001"]) == 6  # less than a process takes to start
    said = capsys.readouterr().err
    assert said.count(": it took longer than 0.001 seconds, and was stopped\n") == 2
    assert {line["attempts"] for line in lines(place / "out", "failed")} == {2}
    assert not results(place / "out")
    (place / "out" / "a").mkdir(exist_ok=True)
    (place / "out" / "a" / "0.ply").write_bytes(b"written just before the process was stopped")
    assert run(words) == 0
    assert len(results(place / "out")) == 2


@LINUX
def test_ctrl_c_leaves_no_process_and_no_half_file(place):
    scans(place / "scans", 60)
    interrupt = at_done(6, "os.killpg(0, signal.SIGINT)")
    words = [*interrupt, "scans", *FAST, "--workers", "2", "-o", "out"]
    done = subprocess.run(words, capture_output=True, text=True, start_new_session=True)
    assert done.returncode == 130 and done.stderr == "cascadenorm: interrupted; no file was left half written\n"
    workers = [int(word) for word in done.stdout.splitlines()[0].split()]
    wait_for(lambda: not any(map(running, workers)))
    assert not list((place / "out").rglob(".*"))
    assert 6 <= len(results(place / "out")) < 60


@contextmanager
def watching(*words: str) -> Iterator[subprocess.Popen]:
    """A watch for the block, which ends with it whatever happens there."""
    command = [*COMMAND, *words, *FAST]
    with subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)


def test_a_watched_folder_gives_each_file_that_comes(place):
    """That a file is left alone while it still grows is a matter of clocks: `test_a_file_settles_…` has its own."""
    scans(place / "other", 2)
    (place / "in").mkdir()
    with watching("in", "-o", "in/out", "--watch", "0.2") as process:
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
    with watching("in", "-o", "out", "--format", "stl", "--watch", "0.5") as process:
        wait_for(lambda: done_so_far(place / "out") == 1, process)
        (place / "in").rename(place / "away")
        assert process.stderr.readline() == "cascadenorm: in: not there at present: the watch goes on\n"
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


def test_a_full_disk_ends_the_batch_and_it_goes_on_later(place, capsys):
    scans(place / "scans", 3)
    words = ["batch", "scans", "-o", "out", *FAST, "--workers", "1"]
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2500, hard))
    try:
        assert run(words) == 5
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert capsys.readouterr().err.endswith("out/manifest.jsonl cannot be written: File too large\n")
    assert not [name for name in results(place / "out") if name.endswith(".part")]
    assert run(words) == 0
    assert len(results(place / "out")) == 3


# the parts


def test_results_lie_as_the_files_do(place):
    scans(place / "scans", 2)
    (place / "scans" / "notes.txt").write_text("no mesh", encoding="ascii")
    (place / "scans" / ".hidden.ply").touch()
    for sources in ("scans", "scans/**/*", [place / "scans"], ["scans/a/*.ply", "scans/b/0.ply"]):
        jobs = find_jobs(sources, Path("out"), "stl")
        assert [job.output for job in jobs] == ["out/a/0.stl", "out/b/0.stl"]
    assert [job.output for job in find_jobs("scans/b/0.ply", Path("out"))] == ["out/0.ply"]
    (place / "scans" / "b" / "0.ply").rename(place / "scans" / "b" / "[0].ply")
    assert [job.source for job in find_jobs("scans/b/[0].ply", Path("out"))] == ["scans/b/[0].ply"]


def test_results_of_denoise_beside_their_sources_are_no_input(place, capsys):
    scans(place / "scans", 2)
    for name in ("a/0_denoised.ply", "a/0_denoised.stl", "b/other_denoised.ply"):
        save_mesh(place / "scans" / name, BALL)
    for sources in ("scans", "scans/**/*"):
        found = {job.output for job in find_jobs(sources, Path("out"))}
        # without a source beside them they may be anything
        assert found == {"out/a/0.ply", "out/b/0.ply", "out/a/0_denoised.stl", "out/b/other_denoised.ply"}
    assert [job.output for job in find_jobs("scans/a/0_denoised.ply", Path("out"))] == ["out/0_denoised.ply"]
    assert run(["batch", "scans/a/0.ply", "-o", "out", *FAST, "--workers", "1"]) == 0
    assert "the results are in out\n" in capsys.readouterr().out


def test_a_folder_that_cannot_be_listed_is_not_passed_over(place, monkeypatch):
    scans(place / "scans", 2)
    listed = os.scandir

    def stale(folder):
        if Path(folder).name == "b":
            raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), folder)
        return listed(folder)

    monkeypatch.setattr(os, "scandir", stale)
    with pytest.raises(ReadError, match=r"scans/b cannot be listed: Stale file handle: try again, or name"):
        find_jobs("scans", Path("out"))


def test_a_file_that_cannot_be_looked_at_now_is_listed_for_the_work_to_say_so(place, monkeypatch):
    scans(place / "scans", 2)
    for name in ("stat", "lstat"):
        true = getattr(os, name)

        def stale(path, *rest, true=true, **options):
            if str(path).endswith("scans/b/0.ply"):
                raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), path)
            return true(path, *rest, **options)

        monkeypatch.setattr(os, name, stale)
    found = {job.source: job.changed is None for job in find_jobs("scans", Path("out"))}
    assert found == {"scans/a/0.ply": False, "scans/b/0.ply": True}


def test_a_file_that_is_given_twice_by_links_is_denoised_once(place):
    scans(place / "scans", 1)
    (place / "scans" / "link.ply").symlink_to(place / "scans" / "a" / "0.ply")
    (place / "scans" / "c").symlink_to(place / "scans" / "a")
    assert len(find_jobs(["scans", "scans/c/*.ply"], Path("out"))) == 1


def test_results_stay_in_their_folder_where_sources_lie_beside_the_working_folder(tmp_path, monkeypatch):
    scans(tmp_path, 2)
    monkeypatch.chdir(tmp_path / "a")
    for sources in (["../b/0.ply", "0.ply"], ["../b", "."], ["../b/*.ply", "../a/*.ply"]):
        outputs = {job.output for job in find_jobs(sources, Path("../a/out"))}
        assert outputs == {"../a/out/a/0.ply", "../a/out/b/0.ply"}


def test_the_largest_file_comes_first_and_results_are_no_input(place):
    scans(place / "scans", 2)
    save_mesh(place / "scans" / "large.ply", icosphere(3))
    save_mesh(place / "scans" / "out.ply", BALL)
    jobs = find_jobs("scans", Path("scans/a"))
    assert [Path(job.source).name for job in jobs] == ["large.ply", "0.ply", "out.ply"]
    assert jobs[0].size == (place / "scans" / "large.ply").stat().st_size


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["none/*.ply"], 3, "none/*.ply: no mesh files were found"),
        (
            ["scans", "-o", "scans"],
            3,
            "scans: no mesh files were found (those in the output folder scans are not read)",
        ),
        (["scans", "--format", "docx"], 5, "the format 'docx' cannot be written"),
        (["scans", "--memory", "much"], 2, "memory is 'much'; it must be an amount of memory with its unit"),
        (["scans", "--memory", "4"], 2, "memory is '4'; it must be an amount of memory with its unit, such as \"4GB\""),
        (["scans", "--timeout", "0"], 2, "--timeout is 0.0; it must be above 0"),
        (["scans", "--timeout", "nan"], 2, "--timeout is nan; it must be above 0"),
        (["scans", "--scheduler", "127.0.0.1:9", "--memory", "1GB"], 2, "memory is for this machine: workers of"),
        (["scans", "--set", "glow=3"], 2, "laplacian has no parameter 'glow'"),
        (["scans", "-o", "scans/a/0.ply"], 5, "scans/a/0.ply is a file: give the name of a folder"),
    ],
)
def test_what_concerns_all_files_is_refused_at_once(place, capsys, words, code, message):
    scans(place / "scans", 2)
    assert run(["batch", *FAST, "-o", "out", *words]) == code
    out, err = capsys.readouterr()
    assert out == "" and err.startswith(f"cascadenorm: {message}") and err.count("\n") == 1
    assert not (place / "out").exists()


@pytest.mark.parametrize("format", ["stl", "STL", ".stl"])
def test_a_format_is_an_extension_with_or_without_its_dot(place, format):
    scans(place / "scans", 1)
    assert run(["batch", *FAST, "scans", "-o", "out", "--format", format]) == 0
    assert set(results(place / "out")) == {"a/0.stl"}


def test_two_files_with_one_place_for_their_results_are_refused(place):
    scans(place / "scans", 1)
    save_mesh(place / "scans" / "a" / "0.obj", BALL)
    with pytest.raises(OutputError, match=r"0\.obj and scans/a/0\.ply would both be written to out/a/0\.stl"):
        denoise_files("scans", "out", format="stl", method="laplacian")


def job(size: int, name: str = "scan.ply") -> Job:
    return Job(name, f"out/{name}", size, 0)


def test_files_run_side_by_side_as_far_as_memory_goes():
    small, middle, large = job(10**4, "s.ply"), job(10**6, "m.ply"), job(10**7, "l.ply")
    place = Place(4, needed(large) + needed(small), processes=4)
    schedule = Schedule()
    schedule.add([small, middle, large])
    assert schedule.next([place]) == (place, large, 3)  # most of the memory, so most of the cores
    assert schedule.next([place]) == (place, small, 1)  # the one in the middle does not fit beside it
    assert schedule.next([place]) is None and schedule.left == 3
    schedule.end(large)
    schedule.again(large)
    assert schedule.next([place]) == (place, middle, 1)
    schedule.end(small)
    assert schedule.next([place]) is None
    schedule.end(middle)
    assert schedule.next([place]) == (place, large, 4)  # again, alone, and with every core
    schedule.end(large)
    assert schedule.left == 0


def test_a_file_larger_than_memory_runs_alone():
    place = Place(2, PROCESS, processes=2)
    schedule = Schedule()
    schedule.add([job(10**9, "a.ply"), job(10**9, "b.ply")])
    assert schedule.next([place]) == (place, job(10**9, "a.ply"), 2)
    assert schedule.next([place]) is None


def test_a_file_goes_where_it_fits_and_to_the_largest_place_when_tried_again():
    large, huge, small = job(10**7, "l.ply"), job(10**9, "h.ply"), job(10, "s.ply")
    narrow, wide = Place(8, needed(small), processes=1), Place(2, needed(large), processes=1)
    schedule = Schedule()
    schedule.add([small, large, huge])
    assert schedule.next([narrow, wide]) == (wide, huge, 2)  # it fits nowhere
    assert schedule.next([narrow, wide]) == (narrow, small, 8)
    assert schedule.next([narrow, wide]) is None and schedule.next([]) is None
    schedule.end(small)
    schedule.again(small)
    assert schedule.next([narrow, wide]) is None
    schedule.end(huge)
    assert schedule.next([narrow, wide]) == (wide, large, 2)
    assert schedule.next([narrow, wide]) is None  # not where memory may have been short
    schedule.end(large)
    assert schedule.next([narrow, wide]) == (wide, small, 2)


def test_a_file_settles_when_it_has_stopped_changing():
    now = [0.0]
    settled = Settled(2.0, lambda: now[0])
    assert settled.take([job(1)]) == []
    now[0] = 1.5
    assert settled.take([job(2)]) == []
    now[0] = 3.0
    assert settled.take([job(2)]) == []
    now[0] = 3.5
    assert settled.take([job(2)]) == [job(2)]
    assert settled.take([job(2)]) == []
    now[0] = 9.0
    assert settled.take([job(3)]) == [] and settled.take([]) == []
    now[0] = 12.0
    assert settled.take([job(3)]) == []  # it had gone
    now[0] = 14.0
    assert settled.take([job(3)]) == [job(3)]


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


def test_half_a_line_does_not_count_and_the_next_is_whole(tmp_path):
    (tmp_path / "manifest.jsonl").write_text('{"output": "a", "status": "done"}\n[1]\n{"output": "b", "sta', "utf-8")
    manifest = Manifest(tmp_path)
    assert set(manifest.last) == {"a"}
    with pytest.raises(OutputError, match="another batch is writing"):
        Manifest(tmp_path)
    manifest.add({"output": "c"})
    manifest.close()
    again = Manifest(tmp_path)
    assert set(again.last) == {"a", "c"}
    again.close()


def test_the_digest_of_the_settings_is_of_all_that_a_result_depends_on(tmp_path):
    mask = tmp_path / "mask.npy"
    np.save(mask, np.ones(4))

    usual = find("laplacian").settings["iterations"].default

    def key(method="laplacian", parameters=None, **controls):
        return settings_of(method, parameters or {}, controls, None, force=False)[0].key

    assert key() == key(threads=1) == key(strength=1.0) == key(parameters={"iterations": usual})
    first = key(mask=str(mask))
    np.save(mask, np.zeros(4))
    others = [key("taubin"), key(parameters={"iterations": usual + 1}), key(strength=0.5), first, key(mask=str(mask))]
    assert len({key(), *others}) == 6
    with pytest.raises(ParameterError, match="cannot be read"):
        key("auto", {"model": tmp_path / "none.safetensors"})


def test_a_limit_that_is_infinite_ends_no_batch(place, capsys):
    scans(place / "scans", 2)
    done = denoise_files("scans", "out", method="laplacian", workers=1, max_displacement=float("inf"))
    assert len(done.lines) == 2 and not done.failures
    assert [line["summary"]["controls"]["max_displacement"] for line in lines(place / "out", "done")] == ["inf"] * 2
    words = ["denoise", "scans/a/0.ply", *FAST, "--max-displacement", "inf", "--json"]
    assert run(words) == 0 and json.loads(capsys.readouterr().out)["controls"]["max_displacement"] == "inf"


def test_a_file_that_changes_while_it_is_read_is_tried_again(place):
    scans(place, 1)
    settings = settings_of("laplacian", {}, {}, None, force=False)[0]
    task = Task(Job("a/0.ply", "out/a/0.ply", 0, 0), None)
    checked = work(settings, task)
    assert checked.status == "new"
    save_mesh(place / "a" / "0.ply", noisy(BALL, 0.1), force=True)
    found = work(settings, task._replace(checked=True, digest=checked.input_digest))
    assert (found.status, found.then) == ("failed", "again") and "changed while it was read" in str(found.error)
    assert not (place / "out" / "a" / "0.ply").exists()
    missing = work(settings, Task(Job("a/1.ply", "out/a/1.ply", 0, None), None))
    assert (missing.status, missing.then) == ("failed", "go on")
    gone = work(settings, Task(Job("a/1.ply", "out/a/1.ply", 10, 5), None))  # since it was listed
    assert (gone.status, gone.then) == ("failed", "again")
    assert str(missing.error) == "a/1.ply cannot be read: No such file or directory"


def test_temporary_files_of_killed_processes_are_removed_and_no_others(tmp_path):
    alike = [f"{'x' * 50}-{number}.ply" for number in (1, 2)]  # the same first 40 characters
    outputs = ["scan.ply", alike[0], "part.gltf"]
    mine = [unfinished_name(name, tmp_path / name) for name in outputs]
    mine += [unfinished_name(name, tmp_path / "part.gltf") for name in ("part.bin", "texture.png")]
    owners = ["scan.obj", "scan.stl", alike[1], "other.ply"]  # the same stem; the same beginning
    others = [unfinished_name(name, tmp_path / name) for name in owners]
    others += ["scan.ply", ".scan.ply.part", ".scan.ply.notes.part"]
    for name in (*mine, *others):
        (tmp_path / name).touch()
    remove_unfinished([*(tmp_path / name for name in outputs), tmp_path / "nowhere" / "scan.ply"])
    assert sorted(os.listdir(tmp_path)) == sorted(others)


def test_one_process_that_ends_early_leaves_the_others():
    workers = [Worker(partial(do_jobs, work=work)) for work in (os._exit, abs)]
    try:
        workers[0].send((7, 1))
        workers[1].send((-3, 1))
        found = {}
        while len(found) < 2:
            for ready in first_ready([worker for worker in workers if worker not in found], None):
                try:
                    found[ready] = ready.receive()
                except WorkerError as error:
                    found[ready] = str(error)
        assert "exit code 7" in found[workers[0]] and found[workers[1]] == 3
        workers[1].send((-4, 1))
        assert workers[1].receive() == 4
    finally:
        Worker.stop(workers)


def slow_to_end(seconds: float) -> None:
    """Let the exit of this process take time."""
    atexit.register(time.sleep, seconds)


def test_a_process_that_is_stopped_while_it_ends_says_nothing(capfd):
    worker = Worker(partial(do_jobs, work=slow_to_end))
    worker.send((1.5, 1))
    worker.receive()
    worker.link.close()
    time.sleep(0.5)  # it has seen that, and is within its exit
    Worker.stop([worker])
    assert capfd.readouterr().err == ""


class OfLibrary(Exception):
    """An error that cannot be made again from its text, as that of lxml."""

    def __init__(self, line: int, column: int) -> None:
        super().__init__(f"line {line}, column {column}")


def answer(task: Task) -> Outcome:
    """An outcome that cannot be read where it arrives, for one file."""
    return Outcome(status="failed", error=OfLibrary(3, 4)) if task.job.source == "odd" else Outcome(status="kept")


def test_a_process_whose_outcome_cannot_be_read_is_stopped_and_the_others_go_on():
    tasks = [Task(job(1, name), None) for name in ("odd", "even")]
    with closing(LocalProcesses(answer, Place(2, PROCESS, processes=2))) as processes:
        for task in tasks:
            processes.begin(processes.places[0], task, 1)
        begun = [worker._process for worker in processes._busy.values()]
        found = {}
        while len(found) < 2:
            found |= dict(processes.ended(None))
        assert found[tasks[1].job] == Outcome(status="kept")
        assert isinstance(found[tasks[0].job], WorkerError) and "cannot be read: TypeError" in str(found[tasks[0].job])
        assert [process.is_alive() for process in begun] == [False, True]
        processes.begin(processes.places[0], tasks[1], 1)
        assert processes.ended(None) == [(tasks[1].job, Outcome(status="kept"))]
    assert not begun[1].is_alive()
