"""Many files: each once, whatever fails, is killed or comes later."""

import json
import multiprocessing
import signal
import subprocess
import sys

import numpy as np
import pytest
from batches import BALL, FAST, LINUX, START, lines, results, running, scans, wait_for
from shapes import noisy

import cascadenorm as cn
from cascadenorm.batch.batch import denoise_files
from cascadenorm.batch.manifest import Manifest
from cascadenorm.cli import run
from cascadenorm.io import output_format
from cascadenorm.io.digests import file_digest
from cascadenorm.io.interop import save_mesh


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


def at_done(count: int, action: str) -> list[str]:
    """The start of a command line whose process does something when so many files are done.

    It is done in the process of the batch, between two files: no test has to be quick enough to see that moment.
    """
    code = f"""
import multiprocessing, os
from cascadenorm.batch.manifest import Manifest
from cascadenorm.execution import worker_processes
worker_processes.TERMINATION_TIMEOUT_S = 24 * 3600.0  # which processes under load need to remove their temporary files
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
    scans(place / "scans", 20)
    words = ["scans", *FAST, "-o", "out", "--workers"]
    kill = at_done(5, "os.kill(os.getpid(), signal.SIGKILL)")
    done = subprocess.run([*kill, *words, "2"], stdout=subprocess.PIPE, text=True)
    assert done.returncode == -signal.SIGKILL
    workers = [int(word) for word in done.stdout.split()]
    assert len(workers) == 2
    wait_for(lambda: not any(map(running, workers)))
    finished = {line["output"] for line in lines(place / "out", "done")}
    assert len(finished) == 5
    assert run(["batch", *words, "1"]) == 0
    assert not list((place / "out").rglob(".*"))
    done = [line["output"] for line in lines(place / "out", "done")]
    assert len(done) == len(set(done)) == 20
    for name in done:
        (place / "alone" / name).parent.mkdir(parents=True, exist_ok=True)
        cn.denoise_file(place / "scans" / name, place / "alone" / name, method="laplacian")
    assert results(place / "out") == results(place / "alone")


@LINUX
def test_a_file_whose_process_is_killed_is_tried_again(place, monkeypatch):
    scans(place / "scans", 20)
    add, killed = Manifest.add, []

    def add_and_kill(manifest, line):
        add(manifest, line)
        if line["status"] == "done" and not killed:
            killed.extend(multiprocessing.active_children())
            for worker in killed:
                worker.kill()

    monkeypatch.setattr(Manifest, "add", add_and_kill)
    found = denoise_files("scans", "out", method="laplacian", workers=2)
    assert len(killed) == 2 and not found.failures
    attempts = [line["attempts"] for line in lines(place / "out", "done")]
    assert len(attempts) == 20 and set(attempts) == {1, 2} and attempts.count(2) <= 2


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
    scans(place / "scans", 20)
    interrupt = at_done(6, "os.killpg(0, signal.SIGINT)")
    words = [*interrupt, "scans", *FAST, "--workers", "2", "-o", "out"]
    done = subprocess.run(words, capture_output=True, text=True, start_new_session=True)
    assert done.returncode == 130 and done.stderr == "cascadenorm: interrupted; no file was left half written\n"
    workers = [int(word) for word in done.stdout.splitlines()[0].split()]
    wait_for(lambda: not any(map(running, workers)))
    assert not list((place / "out").rglob(".*"))
    assert 6 <= len(results(place / "out")) < 20


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
        (["scans", "--memory", "much"], 2, "--memory is 'much'; it must be an amount of memory with its unit"),
        (
            ["scans", "--memory", "4"],
            2,
            "--memory is '4'; it must be an amount of memory with its unit, such as \"4GB\"",
        ),
        (["scans", "--timeout", "0"], 2, "--timeout is 0.0; it must be above 0"),
        (["scans", "--timeout", "nan"], 2, "--timeout is nan; it must be above 0"),
        (["scans", "--scheduler", "127.0.0.1:9", "--memory", "1GB"], 2, "--memory is for this machine: workers of"),
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


def test_a_format_is_an_extension_with_or_without_its_dot(place):
    scans(place / "scans", 1)
    assert {output_format(f".{name}") for name in ("stl", "STL", ".stl")} == {"stl"}
    assert run(["batch", *FAST, "scans", "-o", "out", "--format", ".STL"]) == 0
    assert set(results(place / "out")) == {"a/0.stl"}


def test_limits_that_are_infinite_or_longer_than_the_system_can_wait_end_no_batch(place, capsys):
    scans(place / "scans", 2)
    words = ["batch", "scans", *FAST, "-o", "out", "--workers", "1", "--max-displacement", "inf", "--timeout", "1e9"]
    assert run(words) == 0, capsys.readouterr().err
    assert [line["summary"]["controls"]["max_displacement"] for line in lines(place / "out", "done")] == ["inf"] * 2
    capsys.readouterr()
    words = ["denoise", "scans/a/0.ply", *FAST, "--max-displacement", "inf", "--json"]
    assert run(words) == 0 and json.loads(capsys.readouterr().out)["controls"]["max_displacement"] == "inf"


def test_a_result_that_is_a_link_to_its_source_does_not_overwrite_it(place):
    scans(place / "scans", 1)
    before = results(place / "scans")
    (place / "out").mkdir()
    (place / "out" / "0.ply").symlink_to(place / "scans" / "a" / "0.ply")
    (failure,) = denoise_files("scans/a", "out", method="laplacian", workers=1, force=True).failures
    assert "is a link to" in str(failure.error) and results(place / "scans") == before


def test_a_batch_needs_files_and_takes_them_from_any_iterable(place):
    with pytest.raises(cn.ReadError, match="no files are given"):
        denoise_files([], "out")
    for empty in ("", ["", "scans"]):
        with pytest.raises(cn.ReadError, match="the name of a source is empty: name a file, folder or pattern"):
            denoise_files(empty, "out")
    scans(place / "scans", 2)
    done = denoise_files(iter(sorted((place / "scans").rglob("*.ply"))), "out", method="laplacian", workers=1)
    assert len(done.lines) == 2
