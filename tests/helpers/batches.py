"""Batches of files as the tests run them, and what they leave."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from shapes import icosphere, noisy

from cascadenorm.batch.inputs import Job
from cascadenorm.io.interop import save_mesh

BALL = icosphere(2)
FAST = ["--method", "laplacian"]
START = """
import signal
from cascadenorm.cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background of a shell it is ignored
main()
"""
COMMAND = [sys.executable, "-c", START, "batch"]
LINUX = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="it reads /proc")


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


def job(size: int, name: str = "scan.ply") -> Job:
    return Job(name, f"out/{name}", size, 0)


@contextmanager
def watching(*words: str) -> Iterator[subprocess.Popen]:
    """A watch for the block, which ends with it whatever happens there."""
    command = [*COMMAND, *words, *FAST]
    with subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
