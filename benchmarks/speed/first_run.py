"""What a first run costs after an installation: functions compiled, processor time, with and without compiled kernels.

    python -m benchmarks.speed.first_run WHEEL PLATFORM_WHEEL

The wheels are those of release/check.py and release/platform_wheel.py. The table is printed, and written to
benchmarks/first_run.md.
"""

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path
from typing import NamedTuple

from benchmarks.speed.speed import wavy_torus
from cascadenorm.io.interop import save_mesh

METHODS = ("taubin", "bilateral-normal", "auto")
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
    """Run each method twice with each wheel, from a folder of kernels that is empty at first."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheels", type=Path, nargs=2, metavar="WHEEL")
    parser.add_argument("--output", type=Path, default=Path(__file__).parents[1] / "first_run.md")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor() as pool:  # processor time: runs may overlap
        mesh = Path(folder) / "mesh.ply"
        save_mesh(mesh, wavy_torus(*STEPS))
        sites = [Path(folder) / str(number) for number in range(len(chosen.wheels))]
        for site, wheel in zip(sites, chosen.wheels, strict=True):
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(site)
        runs = pool.map(lambda pair: twice(mesh, *pair), product(METHODS, sites))
        sizes = [f"{wheel.stat().st_size / 1e6:.1f} MB" for wheel in chosen.wheels]
        kinds = [f"{kind}, {size}" for kind, size in zip(("universal", "for one platform"), sizes, strict=True)]
        rows = [
            f"| {method} | {kind} | {first.compiled} | {first.seconds:.1f} | {later.seconds:.1f} |"
            for (method, kind), (first, later) in zip(product(METHODS, kinds), runs, strict=True)
        ]
    text = "\n".join(
        [
            "# The first run",
            "",
            "Processor time of a first and a second run of `cascadenorm denoise` on 10,000 faces, and functions that "
            f"the first one compiled; {platform.system()} {platform.machine()}, Python {platform.python_version()}. "
            "`python -m benchmarks.speed.first_run` writes this page; "
            "[releasing](../docs/releasing.md#compiled-kernels) says how the wheels differ.",
            "",
            "| method | wheel | compiled | first run, s | second run, s |",
            "| --- | --- | ---: | ---: | ---: |",
            *rows,
            "",
        ]
    )
    chosen.output.write_text(text, encoding="utf-8")
    print(text, end="")


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


if __name__ == "__main__":
    main()
