"""Measure the computations of the package in Python: classical methods, and eigenpairs of the Laplacian.

    python -m benchmarks.speed.methods classical [--faces 100000 1000000] [--only METHOD ...] [--record]
    python -m benchmarks.speed.methods harmonics [--vertices N ...] [--count 500] [--record]

`classical` measures time and peak memory of every classical method at its defaults. Each runs on a noisy torus in a
process of its own: once on a small mesh, so that compiling does not count, then on the large one.

`harmonics` times the approximate eigenpairs of the Laplacian against those of Lanczos, and measures their errors.
Seconds are of the processor, all threads together, since they depend less on what else the machine does. The tables are
those of benchmarks/speed.md.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import cascadenorm as cn
from benchmarks import results
from benchmarks.speed.meshes import wavy_torus
from cascadenorm.geometry.spectra.fast_harmonics import fast_harmonics
from cascadenorm.geometry.spectra.harmonics import Harmonics, manifold_harmonics
from cascadenorm.mesh import Mesh

NOISE = 0.2
"""Standard deviation in all directions, in mean edge lengths."""
LIMIT_S = 1800.0
"""Time limit of one run."""
HARMONICS_SIZES = (20_000, 50_000, 100_000, 500_000)
HARMONICS_TITLES = ("vertices", "Lanczos", "approximate", "ratio", "error of the lower half, at most", "of all")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure methods or eigenpairs."""
    methods = [name for name, one in cn.methods().items() if one.family != "learned"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    classical = commands.add_parser("classical", help="time and memory of each classical method")
    classical.add_argument("--faces", type=int, nargs="+", default=[100_000, 1_000_000])
    classical.add_argument("--only", nargs="+", default=methods, metavar="METHOD")
    classical.add_argument("--run", help=argparse.SUPPRESS)  # one method in this process
    results.add_option(classical, "methods")
    harmonics = commands.add_parser("harmonics", help="approximate eigenpairs")
    harmonics.add_argument("--vertices", type=int, action="append", help="may be given several times")
    harmonics.add_argument("--count", type=int, default=500, help="eigenpairs")
    results.add_option(harmonics, "harmonics")
    options = parser.parse_args(arguments)
    if options.command == "harmonics":
        results.report(options.record, eigenpairs(options.vertices or HARMONICS_SIZES, options.count), harmonics_table)
    elif options.run:
        print(json.dumps(run(options.run, options.faces[0])))
    else:
        results.report(options.record, classical_methods(options.only, options.faces), table)


def classical_methods(names: Sequence[str], faces: Sequence[int]) -> dict[str, Any]:
    """Return the figures of each method on meshes of each size."""
    found = {}
    for name in names:
        found[name] = [measured(name, count) for count in faces]
        print(name, *found[name], flush=True)
    return {"machine": results.machine(), "noise": NOISE, "faces": list(faces), "methods": found}


def measured(name: str, faces: int) -> dict[str, Any]:
    """Run one method in a new process; return its figures, or the reason why it failed."""
    command = [sys.executable, "-m", "benchmarks.speed.methods", "classical", "--run", name, "--faces", str(faces)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        return {"failed": f"over {LIMIT_S:.0f} s"}
    if done.returncode:
        return {"failed": (done.stderr.strip().splitlines() or ["killed"])[-1]}
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def run(name: str, faces: int) -> dict[str, float]:
    """Run one method in this process; return wall and processor seconds, and the peak of the process."""
    method = cn.methods()[name]
    for size in (2000, faces):
        mesh = torus(size)
        region = {"region": mesh.vertices[:, 0] > 0} if name == "fairing" else {}
        start, busy = time.perf_counter(), time.process_time()
        method(mesh, **region)
        seconds, processor = time.perf_counter() - start, time.process_time() - busy
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return {"seconds": seconds, "processor": processor, "gibibytes": peak / 2**30}


def torus(faces: int) -> Mesh:
    """Return a rippled torus with about that many faces and noise."""
    size = round((faces / 2) ** 0.5)
    v, u = np.divmod(np.arange(size * size), size)
    next_u, next_v = (u + 1) % size, (v + 1) % size
    a, b, c, d = v * size + u, v * size + next_u, next_v * size + next_u, next_v * size + u
    around, across = 2 * np.pi * u / size, 2 * np.pi * v / size
    tube = 0.4 + 0.02 * np.sin(12 * around) * np.sin(8 * across)
    ring = 1 + tube * np.cos(across)
    vertices = np.stack([ring * np.cos(around), ring * np.sin(around), tube * np.sin(across)], axis=1)
    clean = Mesh(vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]))
    noise = np.random.default_rng(0).normal(size=vertices.shape)
    return clean.moved(vertices + NOISE * clean.mean_edge_length * noise)


def table(figures: results.Figures) -> str:
    """Return a row for each method."""
    rows = [[f"`{name}`", *map(_cell, found)] for name, found in figures["methods"].items()]
    titles = ["method", *(f"{faces:,} faces" for faces in figures["faces"])]
    caption = f"Noise of {figures['noise']:g} mean edge lengths; {figures['machine']}."
    return f"{caption}\n\n{results.markdown(titles, rows)}"


def _cell(found: dict[str, Any]) -> str:
    if "failed" in found:
        return f"failed: {found['failed']}"
    return f"{found['seconds']:.1f} s ({found['processor']:.1f} s), {found['gibibytes']:.2f} GiB"


def eigenpairs(sizes: Sequence[int], count: int) -> dict[str, Any]:
    """Compare the approximate eigenpairs with exact ones on noisy tori with about these numbers of vertices."""
    meshes: list[dict[str, Any]] = []
    fast_harmonics(wavy_torus(126, 63), 20)  # kernels are compiled once, and kept
    for vertices in sizes:
        across = round((vertices / 2) ** 0.5)
        meshes.append(compared(wavy_torus(2 * across, across), count))
        print(meshes[-1], flush=True)
    return {"machine": results.machine(), "count": count, "meshes": meshes}


def compared(mesh: Mesh, count: int) -> dict[str, Any]:
    """Return the seconds of both computations, and the largest relative errors of the approximate eigenvalues."""
    fast_seconds, fast = timed(fast_harmonics, mesh, count)
    exact_seconds, exact = timed(manifold_harmonics, mesh, count)
    errors = fast.values[1:] / exact.values[1:] - 1  # the first is 0
    return {
        "vertices": len(mesh.vertices),
        "exact": exact_seconds,
        "fast": fast_seconds,
        "ratio": exact_seconds / fast_seconds,
        "lower_half": float(errors[: count // 2].max()),
        "largest": float(errors.max()),
    }


def timed(function: Callable[[Mesh, int], Harmonics], mesh: Mesh, count: int) -> tuple[float, Harmonics]:
    """Return the processor seconds of a function on a fresh mesh, and its result."""
    fresh = Mesh(mesh.vertices, mesh.faces)
    start = time.process_time()
    found = function(fresh, count)
    return time.process_time() - start, found


def harmonics_table(figures: results.Figures) -> str:
    """Return a row for each mesh."""
    rows = [
        [
            *(f"{one['vertices']:,}", f"{one['exact']:.0f}", f"{one['fast']:.1f}", f"{one['ratio']:.1f}"),
            *(f"{100 * one['lower_half']:.1f} %", f"{100 * one['largest']:.1f} %"),
        ]
        for one in figures["meshes"]
    ]
    return f"{figures['count']} eigenpairs; {figures['machine']}.\n\n{results.markdown(HARMONICS_TITLES, rows)}"


if __name__ == "__main__":
    main()
