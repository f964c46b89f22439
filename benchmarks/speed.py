"""Time whole commands, from the first byte read to the last one written.

python benchmarks/speed.py [--method NAME ...]

The meshes are made here: a torus with waves and noise along its normals. The table is printed, and written to
benchmarks/speed.md.
"""

import argparse
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cascadenorm.interop import save_mesh
from cascadenorm.mesh import Mesh, thread_count

SIZES = {"100 k faces": (250, 200), "1 M faces": (1000, 500)}
NOISE = 0.2  # mean edge lengths
WATCH = """
import resource, subprocess, sys, time
start = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
print(time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
"""A process that does little else, since a new process is charged with the memory of the one that starts it."""


class Run(NamedTuple):
    """One command: how long it took, and the most memory that it held."""

    seconds: float
    gibibytes: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Time the start and each method on meshes of two sizes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--method", action="append", help="may be given several times")
    parser.add_argument("--output", type=Path, default=Path(__file__).with_name("speed.md"))
    chosen = parser.parse_args(arguments)
    methods = chosen.method or ["auto", "cascade", "bilateral-normal"]
    rows = [("`cascadenorm --help`", timed(["--help"]))]
    with tempfile.TemporaryDirectory() as folder:
        warm = Path(folder) / "warm.ply"
        save_mesh(warm, wavy_torus(40, 30))
        for method in methods:
            denoised(warm, method)  # kernels are compiled once, and kept
        for size, steps in SIZES.items():
            mesh = Path(folder) / f"{steps[0]}.ply"
            save_mesh(mesh, wavy_torus(*steps))
            rows += [(f"{method}, {size}", denoised(mesh, method)) for method in methods]
    machine = f"{thread_count()} threads, {platform.system()} {platform.machine()}, Python {platform.python_version()}"
    lines = [
        "# Time and memory of whole commands",
        "",
        f"Reading and writing included, kernels compiled before; {machine}. "
        "`python benchmarks/speed.py` writes this page.",
        "",
        "| command | seconds | peak memory, GiB |",
        "| --- | ---: | ---: |",
        *(f"| {name} | {run.seconds:.2f} | {run.gibibytes:.2f} |" for name, run in rows),
    ]
    text = "\n".join(lines) + "\n"
    chosen.output.write_text(text, encoding="utf-8")
    print(text, end="")


def denoised(mesh: Path, method: str) -> Run:
    """Time the denoising of a file."""
    return timed(["denoise", str(mesh), "-o", str(mesh.with_suffix(".out.ply")), "--method", method, "--force"])


def timed(arguments: Sequence[str]) -> Run:
    """Run the command line in a process of its own."""
    command = [sys.executable, "-c", WATCH, sys.executable, "-m", "cascadenorm", *arguments]
    seconds, memory = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.split()
    unit = 1 if sys.platform == "darwin" else 1024
    return Run(float(seconds), int(memory) * unit / 2**30)


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
