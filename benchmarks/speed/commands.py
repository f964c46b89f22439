"""Time whole commands, from the first byte read to the last one written.

    python -m benchmarks.speed.commands [--method NAME ...] [--environment DIR] [--record]

The meshes are generated: a torus with waves, and noise along its normals. PyMeshLab, the fastest of the other
libraries, is installed into an environment of its own. The table is that of benchmarks/speed.md; the plan in
benchmarks/scale.md is computed from the same record.
"""

import argparse
import tempfile
from collections.abc import Sequence
from math import log, prod
from pathlib import Path
from typing import Any

from benchmarks import results
from benchmarks.environments import interpreter
from benchmarks.speed.meshes import shuffled, wavy_torus
from benchmarks.speed.processes import COMMAND, Run, timed
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import thread_count

SIZES = {"10 k faces": (100, 50), "100 k faces": (250, 200), "1 M faces": (1000, 500), "5 M faces": (2500, 1000)}
SMALL, SHUFFLED, LARGEST = "100 k faces", "1 M faces", "5 M faces"
METHODS = ("auto", "cascade", "bilateral-normal", "guided-normal", "tv-normal", "l0", "taubin")
MAIN = ("auto", "bilateral-normal")
"""Methods that also run on the largest mesh, and on a shuffled one."""
ENOUGH = 3, 10.0
"""Runs of a command, of which the fastest counts, unless they have taken so many seconds before."""
PEER = "PyMeshLab two-step"
TWO_STEP = """
import pymeshlab, sys
meshes = pymeshlab.MeshSet(verbose=False)
meshes.load_new_mesh(sys.argv[1])
meshes.apply_coord_two_steps_smoothing()
meshes.save_current_mesh(sys.argv[2])
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Time the start, and each method on meshes of several sizes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--method", action="append", help="may be given several times")
    parser.add_argument("--environment", type=Path, default=Path("build/peers"), help="of PyMeshLab")
    results.add_option(parser, "commands")
    options = parser.parse_args(arguments)
    peer = interpreter(options.environment, ["pymeshlab"])
    runs = measured(options.method or METHODS, peer)
    figures = {"machine": results.machine(), "threads": thread_count(), "runs": runs}
    results.report(options.record, figures, table)


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
    """Run a command several times if it is short, and return the fastest run."""
    runs: list[Run] = []
    while len(runs) < ENOUGH[0] and sum(run.seconds for run in runs) < ENOUGH[1]:
        runs.append(timed(command))
    return min(runs)


def table(figures: results.Figures) -> str:
    """Return a row for each command, and how the times grow with the faces."""
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
    """Return with which power of the faces the times of methods grow."""
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


if __name__ == "__main__":
    main()
