"""Measure time and peak memory of every classical method, at its defaults.

    python -m benchmarks.speed.methods [--faces 100000 1000000] [--only METHOD ...] [--record]

Each method runs on a noisy torus in a process of its own: once on a small mesh, so that compiling does not count, then
on the large one. The table is that of benchmarks/speed.md.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks import results
from cascadenorm import baselines
from cascadenorm.mesh import Mesh
from cascadenorm.registry import find, registered

NOISE = 0.2
"""Standard deviation in all directions, in mean edge lengths."""
LIMIT_S = 1800.0
"""Of one run."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure the methods."""
    classical = [name for name in registered() if find(name).function.__module__.startswith(baselines.__name__)]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faces", type=int, nargs="+", default=[100_000, 1_000_000])
    parser.add_argument("--only", nargs="+", default=classical, metavar="METHOD")
    parser.add_argument("--run", help=argparse.SUPPRESS)  # one method in this process
    results.add_option(parser, "methods")
    options = parser.parse_args(arguments)
    if options.run:
        print(json.dumps(run(options.run, options.faces[0])))
        return
    found = {}
    for name in options.only:
        found[name] = [measured(name, faces) for faces in options.faces]
        print(name, *found[name], flush=True)
    figures = {"machine": results.machine(), "noise": NOISE, "faces": options.faces, "methods": found}
    results.report(options.record, figures, table)


def measured(name: str, faces: int) -> dict[str, Any]:
    """Run one method in a new process; return its figures, or why it failed."""
    command = [sys.executable, "-m", "benchmarks.speed.methods", "--run", name, "--faces", str(faces)]
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
    method = find(name)
    for size in (2000, faces):
        mesh = torus(size)
        region = {"region": mesh.vertices[:, 0] > 0} if name == "fairing" else {}
        start, busy = time.perf_counter(), time.process_time()
        method(mesh, **region)
        seconds, processor = time.perf_counter() - start, time.process_time() - busy
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return {"seconds": seconds, "processor": processor, "gibibytes": peak / 2**30}


def torus(faces: int) -> Mesh:
    """Return a rippled torus of about that many faces, with noise."""
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


if __name__ == "__main__":
    main()
