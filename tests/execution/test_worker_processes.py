"""Processes that do one job after the other, each for itself."""

import atexit
import ctypes
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from threading import Event

import pytest

from cascadenorm.errors import WorkerError
from cascadenorm.execution.worker_processes import Worker, do_jobs, first_ready


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


def test_a_script_without_a_guard_is_told_what_it_lacks(tmp_path):
    script = tmp_path / "script.py"
    script.write_text("from cascadenorm.execution.worker_processes import Worker\nWorker(abs).receive()\n")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True)
    lines = done.stderr.splitlines()
    assert "exit code 1): in a script of your own, start the work below `if __name__ == '__main__':`" in lines[-1]


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


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no exit can be swallowed here")
def test_an_exit_that_a_callback_of_a_library_swallows_is_made_again(tmp_path, capfd):
    worker = Worker(partial(do_jobs, work=terminated_in_a_callback))
    worker.send((tmp_path / "cleaned", 1))
    with pytest.raises(WorkerError):
        worker.receive()
    Worker.stop([worker])
    assert (tmp_path / "cleaned").exists() and capfd.readouterr().err == ""


def terminated_in_a_callback(path: Path) -> None:
    """Receive SIGTERM within a callback from C, where Python cannot raise SystemExit, then work on."""

    def callback() -> None:
        signal.raise_signal(signal.SIGTERM)

    try:
        ctypes.CFUNCTYPE(None)(callback)()
        Event().wait()
    finally:
        path.touch()
