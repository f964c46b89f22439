"""Time and memory of commands, each in a process of its own."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

COMMAND = (sys.executable, "-m", "cascadenorm")
WATCH = """
import resource, subprocess, sys, time
start = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(time.perf_counter() - start, used.ru_utime + used.ru_stime, used.ru_maxrss)
"""
"""A small process that starts the command, since a new process is charged with the memory of the one that starts it."""
SETTINGS = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""Environment of a command, in which Python keeps modules compiled, as pip does when it installs them."""


class Run(NamedTuple):
    """One command.

    Parameters
    ----------
    seconds
        Wall time.
    processor
        Processor time of all threads, user and system, in seconds.
    memory
        Peak of the resident memory, in bytes.
    """

    seconds: float
    processor: float
    memory: int


def timed(command: Sequence[str | Path]) -> Run:
    """Run a command; raises CalledProcessError if it fails."""
    watched = [sys.executable, "-c", WATCH, *command]
    done = subprocess.run(watched, check=True, stdout=subprocess.PIPE, text=True, env=SETTINGS)
    seconds, processor, memory = done.stdout.split()
    return Run(float(seconds), float(processor), int(memory) * (1 if sys.platform == "darwin" else 1024))
