"""Measure what a first run costs after an installation, with and without compiled kernels.

    python -m benchmarks.speed.first_run WHEEL PLATFORM_WHEEL [--record]

The wheels are those of release/check.py and release/platform_wheel.py. Each method runs twice with each wheel, from an
empty kernel cache. The table has the processor time of both runs and the number of functions that the first one
compiled; it is that of benchmarks/speed.md.
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
from pathlib import Path
from typing import NamedTuple

from benchmarks import results
from benchmarks.speed.meshes import wavy_torus
from cascadenorm.io.interop import save_mesh

METHODS = ("taubin", "bilateral-normal", "auto")
KINDS = ("universal", "for one platform")
STEPS = 100, 50
"""Of the torus: 10,000 faces."""
WATCH = """
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


class Run(NamedTuple):
    """One command: functions that numba compiled for it, and seconds of processor time."""

    compiled: int
    seconds: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Run each method twice with each wheel."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheels", type=Path, nargs=2, metavar="WHEEL")
    results.add_option(parser, "first-run")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor() as pool:  # processor time: runs may overlap
        mesh = Path(folder, "mesh.ply")
        save_mesh(mesh, wavy_torus(*STEPS))
        sites = {kind: Path(folder, str(number)) for number, kind in enumerate(KINDS)}
        for site, wheel in zip(sites.values(), options.wheels, strict=True):
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(site)
        asked = list(product(METHODS, KINDS))
        found = pool.map(lambda pair: twice(mesh, pair[0], sites[pair[1]]), asked)
        runs = [
            [method, kind, first.compiled, first.seconds, later.seconds]
            for (method, kind), (first, later) in zip(asked, found, strict=True)
        ]
    wheels = {kind: wheel.stat().st_size / 1e6 for kind, wheel in zip(KINDS, options.wheels, strict=True)}
    results.report(options.record, {"machine": results.machine(), "wheels": wheels, "runs": runs}, table)


def twice(mesh: Path, method: str, site: Path) -> tuple[Run, Run]:
    """Denoise twice with the package in a folder; kernels are kept beside it, and there are none at first."""
    environment = os.environ | {"PYTHONPATH": str(site), "NUMBA_CACHE_DIR": f"{site}-{method}"}
    words = ["denoise", mesh, "--method", method, "-o", f"{site}-{method}.ply", "--force", "--json"]
    command = [sys.executable, "-c", WATCH, *words]
    runs = []
    for _ in range(2):
        done = subprocess.run(command, cwd=mesh.parent, env=environment, stdout=subprocess.PIPE, text=True, check=True)
        compiled, seconds = done.stdout.split()[-2:]
        runs.append(Run(int(compiled), float(seconds)))
    return runs[0], runs[1]


def table(figures: results.Figures) -> str:
    """Return a row for each method and wheel."""
    rows = [
        [method, f"{kind}, {figures['wheels'][kind]:.1f} MB", f"{compiled}", f"{first:.1f}", f"{later:.1f}"]
        for method, kind, compiled, first, later in figures["runs"]
    ]
    titles = ["method", "wheel", "compiled", "first run, s", "second run, s"]
    return f"{figures['machine']}.\n\n{results.markdown(titles, rows)}"


if __name__ == "__main__":
    main()
