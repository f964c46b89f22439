"""Time whole commands, from the first byte read to the last one written.

python -m benchmarks.speed.speed [--method NAME ...] [--environment DIR]

The meshes are made here: a torus with waves and noise along its normals. PyMeshLab, the fastest peer, is installed into
an environment of its own. The table is printed, and written to benchmarks/speed.md.
"""

import argparse
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from math import log
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.environments import interpreter
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh, thread_count

SIZES = {"10 k faces": (100, 50), "100 k faces": (250, 200), "1 M faces": (1000, 500), "5 M faces": (2500, 1000)}
SMALL, SHUFFLED, LARGEST = "100 k faces", "1 M faces", "5 M faces"
METHODS = ("auto", "cascade", "bilateral-normal", "guided-normal", "tv-normal", "l0", "taubin")
MAIN = ("auto", "bilateral-normal")
"""Methods that also run on the largest mesh, and on a shuffled one."""
NOISE = 0.2  # mean edge lengths
ENOUGH = 3, 10.0
"""Runs of a command, of which the fastest counts, unless they have taken so many seconds before."""
TWO_STEP = """
import pymeshlab, sys
meshes = pymeshlab.MeshSet(verbose=False)
meshes.load_new_mesh(sys.argv[1])
meshes.apply_coord_two_steps_smoothing()
meshes.save_current_mesh(sys.argv[2])
"""
WATCH = """
import resource, subprocess, sys, time
start = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
print(time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
"""A process that does little else, since a new process is charged with the memory of the one that starts it."""


COMMAND = (sys.executable, "-m", "cascadenorm")
SETTINGS = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""Environment of a command, in which Python keeps modules compiled, as pip does when it installs them."""


class Run(NamedTuple):
    """One command: how long it took, and the most memory that it held."""

    seconds: float
    gibibytes: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Time the start, and each method on meshes of several sizes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--method", action="append", help="may be given several times")
    parser.add_argument("--environment", type=Path, default=Path("build/peers"), help="of PyMeshLab")
    parser.add_argument("--output", type=Path, default=Path(__file__).parents[1] / "speed.md")
    chosen = parser.parse_args(arguments)
    methods = chosen.method or METHODS
    peer = interpreter(chosen.environment, ["pymeshlab"])
    runs = {"`cascadenorm --help`": timed(COMMAND, "--help")}
    with tempfile.TemporaryDirectory() as folder:
        mesh, poor, result = (Path(folder) / name for name in ("mesh.ply", "shuffled.ply", "result.ply"))
        save_mesh(mesh, wavy_torus(40, 30))
        for name in methods:
            denoised(mesh, name, result)  # kernels are compiled once, and kept
        for size, steps in SIZES.items():
            torus = wavy_torus(*steps)
            save_mesh(mesh, torus, force=True)
            for name in methods:
                if name in MAIN or size != LARGEST:
                    runs[f"{name}, {size}"] = denoised(mesh, name, result)
            if size == SHUFFLED:
                save_mesh(poor, shuffled(torus))
                for name in [name for name in MAIN if name in methods]:
                    runs[f"{name}, {size}, shuffled"] = denoised(poor, name, result)
            runs[f"PyMeshLab two-step, {size}"] = timed([peer, "-c", TWO_STEP], mesh, result)
    machine = f"{thread_count()} threads, {platform.system()} {platform.machine()}, Python {platform.python_version()}"
    lines = [
        "# Time and memory of whole commands",
        "",
        f"Reading and writing included, kernels compiled before; the fastest of up to {ENOUGH[0]} runs; {machine}. "
        "`python -m benchmarks.speed.speed` writes this page. PyMeshLab's filter is "
        "`apply_coord_two_steps_smoothing`, in a process of its own, too.",
        "",
        "| command | seconds | peak memory, GiB |",
        "| --- | ---: | ---: |",
        *(f"| {name} | {run.seconds:.2f} | {run.gibibytes:.2f} |" for name, run in runs.items()),
        "",
        *growth(runs),
    ]
    text = "\n".join(lines) + "\n"
    chosen.output.write_text(text, encoding="utf-8")
    print(text, end="")


def growth(runs: dict[str, Run]) -> list[str]:
    """Say with which power of the faces the times of methods grow."""
    lines = []
    for name in MAIN:
        if f"{name}, {LARGEST}" in runs:
            times = runs[f"{name}, {LARGEST}"].seconds / runs[f"{name}, {SMALL}"].seconds
            power = log(times) / log(np.prod(SIZES[LARGEST]) / np.prod(SIZES[SMALL]))
            lines.append(
                f"The time of `{name}` grows with the power {power:.2f} of the faces from {SMALL} to {LARGEST}."
            )
    return lines


def denoised(mesh: Path, method: str, result: Path) -> Run:
    """Time the denoising of a file."""
    return timed(COMMAND, "denoise", mesh, "-o", result, "--method", method, "--force")


def timed(command: Sequence[str | Path], *arguments: str | Path) -> Run:
    """Run a command in a process of its own, several times if it is short."""
    unit = 1 if sys.platform == "darwin" else 1024
    runs: list[Run] = []
    while len(runs) < ENOUGH[0] and sum(run.seconds for run in runs) < ENOUGH[1]:
        watched = [sys.executable, "-c", WATCH, *command, *arguments]
        done = subprocess.run(watched, check=True, stdout=subprocess.PIPE, text=True, env=SETTINGS)
        seconds, memory = done.stdout.split()
        runs.append(Run(float(seconds), int(memory) * unit / 2**30))
    return min(runs)


def shuffled(mesh: Mesh) -> Mesh:
    """Return the mesh with vertices and faces in an arbitrary order."""
    random = np.random.default_rng(0)
    order = random.permutation(len(mesh.vertices))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return Mesh(mesh.vertices[order], rank[random.permutation(mesh.faces)])


def wavy_torus(around: int, across: int) -> Mesh:
    """Make a closed mesh of 2 · around · across faces, with noise."""
    u, v = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(across) * 2 * np.pi / across, indexing="ij")
    normal = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    middle = np.stack([np.cos(u), np.sin(u), np.zeros_like(u)], axis=-1)
    vertices = (middle + (0.5 + 0.02 * np.sin(9 * u) * np.sin(7 * v))[..., None] * normal).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    mesh = Mesh(vertices, faces)
    size = np.random.default_rng(0).normal(scale=NOISE * mesh.mean_edge_length, size=len(vertices))
    return mesh.moved(vertices + size[:, None] * normal.reshape(-1, 3))


if __name__ == "__main__":
    main()
