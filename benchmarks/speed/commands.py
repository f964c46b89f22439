"""Time whole commands: on meshes of several sizes, and in the first run after an installation.

    python -m benchmarks.speed.commands times [--method NAME ...] [--environment DIR] [--record]
    python -m benchmarks.speed.commands first-run WHEEL PLATFORM_WHEEL [--record]

`times` measures from the first byte read to the last one written, on generated tori with waves and noise along their
normals. PyMeshLab, the fastest of the other libraries, is installed into an environment of its own. The plan in
benchmarks/scale.md is computed from the same record.

`first-run` compares wheels with and without compiled kernels, which release/check.py and release/platform_wheel.py
build. Each method runs twice with each wheel, from an empty kernel cache. Measured are the processor time of both runs
and the number of functions that the first one compiled. The tables are those of benchmarks/speed.md.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from math import log, prod
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks import results
from benchmarks.environments import interpreter
from benchmarks.speed.meshes import shuffled, wavy_torus
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import thread_count

COMMAND = (sys.executable, "-m", "cascadenorm")
WATCH = """
import resource, subprocess, sys, time
start = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(time.perf_counter() - start, used.ru_utime + used.ru_stime, used.ru_maxrss)
"""
"""A small process that starts the command, because a new process is charged with the memory of its parent."""
SETTINGS = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""Environment of a command, in which Python caches compiled modules as pip does during installation."""
SIZES = {"10 k faces": (100, 50), "100 k faces": (250, 200), "1 M faces": (1000, 500), "5 M faces": (2500, 1000)}
SMALL, SHUFFLED, LARGEST = "100 k faces", "1 M faces", "5 M faces"
METHODS = ("auto", "cascade", "bilateral-normal", "guided-normal", "tv-normal", "l0", "taubin")
MAIN = ("auto", "bilateral-normal")
"""Methods that also run on the largest mesh, and on a shuffled one."""
ENOUGH = 3, 10.0
"""Number of runs, of which the fastest counts, and seconds after which no further run is started."""
PEER = "PyMeshLab two-step"
TWO_STEP = """
import pymeshlab, sys
meshes = pymeshlab.MeshSet(verbose=False)
meshes.load_new_mesh(sys.argv[1])
meshes.apply_coord_two_steps_smoothing()
meshes.save_current_mesh(sys.argv[2])
"""

INSTALLED = ("taubin", "bilateral-normal", "auto")
"""Methods that are timed after an installation."""
WHEELS = ("universal", "for one platform")
COUNT_COMPILED = """
import resource, sys
from numba.core import event
compiled = []

class Listener(event.Listener):
    def on_start(self, event):
        compiled.append(event)

    def on_end(self, event):
        pass

event.register("numba:compile", Listener())
from cascadenorm.cli import run
code = run(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_SELF)
print(len(compiled), used.ru_utime + used.ru_stime)
sys.exit(code)
"""


class FirstRun(NamedTuple):
    """One command: functions that numba compiled for it, and seconds of processor time."""

    compiled: int
    seconds: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Time commands, or first runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    times = commands.add_parser("times", help="of the start, and of each method on meshes of several sizes")
    times.add_argument("--method", action="append", help="may be given several times")
    times.add_argument("--environment", type=Path, default=Path("build/peers"), help="of PyMeshLab")
    results.add_option(times, "commands")
    first = commands.add_parser("first-run", help="with and without compiled kernels")
    first.add_argument("wheels", type=Path, nargs=2, metavar="WHEEL")
    results.add_option(first, "first-run")
    options = parser.parse_args(arguments)
    if options.command == "times":
        runs = measured(options.method or METHODS, interpreter(options.environment, ["pymeshlab"]))
        figures = {"machine": results.machine(), "threads": thread_count(), "runs": runs}
        results.report(options.record, figures, table)
    else:
        results.report(options.record, first_runs(options.wheels), first_run_table)


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


def measured(methods: Sequence[str], peer: Path) -> list[dict[str, Any]]:
    """Return seconds and gibibytes of each command."""
    found: list[dict[str, Any]] = []

    def add(name: str, size: str | None, command: Sequence[str | Path]) -> None:
        run = fastest(command)
        found.append({"name": name, "size": size, "seconds": run.seconds, "gibibytes": run.memory / 2**30})
        print(found[-1], flush=True)

    add("`cascadenorm --help`", None, [*COMMAND, "--help"])
    with tempfile.TemporaryDirectory() as folder:
        mesh, poor, result = (Path(folder, name) for name in ("mesh.ply", "shuffled.ply", "result.ply"))

        def denoising(source: Path, method: str) -> list[str | Path]:
            return [*COMMAND, "denoise", source, "-o", result, "--method", method, "--force"]

        save_mesh(mesh, wavy_torus(40, 30))
        for name in methods:
            timed(denoising(mesh, name))  # kernels are compiled once, and kept
        for size, steps in SIZES.items():
            torus = wavy_torus(*steps)
            save_mesh(mesh, torus, force=True)
            for name in methods:
                if name in MAIN or size != LARGEST:
                    add(name, size, denoising(mesh, name))
            if size == SHUFFLED:
                save_mesh(poor, shuffled(torus))
                for name in [name for name in MAIN if name in methods]:
                    add(name, f"{size}, shuffled", denoising(poor, name))
            add(PEER, size, [peer, "-c", TWO_STEP, mesh, result])
    return found


def fastest(command: Sequence[str | Path]) -> Run:
    """Run a command, several times if it is short, and return the fastest run."""
    runs: list[Run] = []
    while len(runs) < ENOUGH[0] and sum(run.seconds for run in runs) < ENOUGH[1]:
        runs.append(timed(command))
    return min(runs)


def table(figures: results.Figures) -> str:
    """Return a row for each command and the growth of the times with the number of faces."""
    rows = [
        [
            ", ".join(word for word in (run["name"], run["size"]) if word),
            f"{run['seconds']:.2f}",
            f"{run['gibibytes']:.2f}",
        ]
        for run in figures["runs"]
    ]
    parts = [
        f"The fastest of up to {ENOUGH[0]} runs; {figures['machine']}.",
        results.markdown(["command", "seconds", "peak memory, GiB"], rows),
        *growth(figures),
    ]
    return "\n\n".join(parts)


def growth(figures: results.Figures) -> list[str]:
    """Return the exponents with which the times of methods grow with the number of faces."""
    seconds = {(run["name"], run["size"]): run["seconds"] for run in figures["runs"]}
    lines = []
    for name in MAIN:
        if (name, LARGEST) in seconds:
            ratio = seconds[name, LARGEST] / seconds[name, SMALL]
            power = log(ratio) / log(prod(SIZES[LARGEST]) / prod(SIZES[SMALL]))
            lines.append(
                f"The time of `{name}` grows with the power {power:.2f} of the faces from {SMALL} to {LARGEST}."
            )
    return lines


def first_runs(packages: Sequence[Path]) -> dict[str, Any]:
    """Run each method twice with each wheel."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor() as pool:  # processor time: runs may overlap
        mesh = Path(folder, "mesh.ply")
        save_mesh(mesh, wavy_torus(*SIZES["10 k faces"]))
        sites = {kind: Path(folder, str(number)) for number, kind in enumerate(WHEELS)}
        for site, wheel in zip(sites.values(), packages, strict=True):
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(site)
        asked = list(product(INSTALLED, WHEELS))
        found = pool.map(lambda pair: twice(mesh, pair[0], sites[pair[1]]), asked)
        runs = [
            [method, kind, first.compiled, first.seconds, later.seconds]
            for (method, kind), (first, later) in zip(asked, found, strict=True)
        ]
    wheels = {kind: wheel.stat().st_size / 1e6 for kind, wheel in zip(WHEELS, packages, strict=True)}
    return {"machine": results.machine(), "wheels": wheels, "runs": runs}


def twice(mesh: Path, method: str, site: Path) -> tuple[FirstRun, FirstRun]:
    """Denoise twice with the package in a folder. Kernels are cached next to it; the cache is empty at first."""
    environment = os.environ | {"PYTHONPATH": str(site), "NUMBA_CACHE_DIR": f"{site}-{method}"}
    words = ["denoise", mesh, "--method", method, "-o", f"{site}-{method}.ply", "--force", "--json"]
    command = [sys.executable, "-c", COUNT_COMPILED, *words]
    runs = []
    for _ in range(2):
        done = subprocess.run(command, cwd=mesh.parent, env=environment, stdout=subprocess.PIPE, text=True, check=True)
        compiled, seconds = done.stdout.split()[-2:]
        runs.append(FirstRun(int(compiled), float(seconds)))
    return runs[0], runs[1]


def first_run_table(figures: results.Figures) -> str:
    """Return a row for each method and wheel."""
    rows = [
        [method, f"{kind}, {figures['wheels'][kind]:.1f} MB", f"{compiled}", f"{first:.1f}", f"{later:.1f}"]
        for method, kind, compiled, first, later in figures["runs"]
    ]
    titles = ["method", "wheel", "compiled", "first run, s", "second run, s"]
    return f"{figures['machine']}.\n\n{results.markdown(titles, rows)}"


if __name__ == "__main__":
    main()
