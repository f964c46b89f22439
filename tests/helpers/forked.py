"""Runs programs in forks of a process that has imported numba and started its compiler, which takes seconds."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

SERVER = """
import json, os, runpy, sys, traceback
import numba
numba.njit(lambda a: a)(1)
import cascadenorm.compute.kernels  # measures the time of what is compiled from here on

for line in sys.stdin:
    path, arguments, environment = json.loads(line)
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(writing, 1)
        os.dup2(writing, 2)
        os.environ.clear()
        os.environ.update(environment)
        numba.config.reload_config()
        os.chdir(os.path.dirname(path))
        sys.argv[:] = [path, *arguments]
        sys.path.insert(0, os.path.dirname(path))
        status = 1
        try:
            runpy.run_path(path, run_name="__main__")
            status = 0
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush()
        os._exit(status)
    os.close(writing)
    with open(reading, errors="replace") as output:
        text = output.read()
    print(json.dumps([os.waitpid(child, 0)[1], text]), flush=True)
"""


def run_alone(path: Path, *arguments: str, **variables: str) -> str:
    """Run a program in its folder with further variables of the environment; what it prints."""
    command = [sys.executable, path, *arguments]
    done = subprocess.run(command, cwd=path.parent, env=os.environ | variables, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@contextmanager
def forking() -> Iterator[Callable[..., str]]:
    """Does as `run_alone`, in forks of one process; where no process can be forked, it is `run_alone`."""
    if not hasattr(os, "fork"):
        yield run_alone
        return
    command = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", SERVER]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    compiling = os.environ | {"NUMBA_DISABLE_JIT": "0"}  # whether a program compiles is for its own variables to say
    with subprocess.Popen(command, **pipes, env=compiling, text=True) as server:

        def run(path: Path, *arguments: str, **variables: str) -> str:
            print(json.dumps([str(path), arguments, os.environ | variables]), file=server.stdin, flush=True)
            status, text = json.loads(server.stdout.readline())
            assert status == 0, text
            return text

        yield run
