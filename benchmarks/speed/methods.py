"""Time and peak memory of every registered method, at its defaults, on a noisy torus.

    python -m benchmarks.speed.methods

    python -m benchmarks.speed.methods [--faces 100000 1000000] [--only METHOD …]

Each method runs in a process of its own: once on a small mesh, so that compiling does not count, then on the large
one. Writes benchmarks/methods.md, in which a run that failed has its last line of error.
"""

import argparse
import json
import platform
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from cascadenorm import baselines
from cascadenorm.mesh import Mesh, thread_count
from cascadenorm.registry import find, registered

NOISE = 0.2  # mean edge lengths, in all directions
LIMIT = 1800.0  # seconds for one run


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


def run(name: str, faces: int) -> dict[str, float]:
    """Run one method in this process; seconds by the clock and of all threads, and the process's peak in GiB."""
    method = find(name)
    for size in (2000, faces):
        mesh = torus(size)
        region = {"region": mesh.vertices[:, 0] > 0} if name == "fairing" else {}
        start, busy = time.perf_counter(), time.process_time()
        method(mesh, **region)
        seconds, cpu = time.perf_counter() - start, time.process_time() - busy
    return {"seconds": seconds, "cpu": cpu, "gib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20}


def measured(name: str, faces: int) -> str:
    """Run one method in a new process; its cell of the table."""
    command = [sys.executable, "-m", "benchmarks.speed.methods", "--run", name, "--faces", str(faces)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return f"over {LIMIT:.0f} s"
    if done.returncode:
        return f"failed: {(done.stderr.strip().splitlines() or ['killed'])[-1]}"
    result = json.loads(done.stdout)
    return f"{result['seconds']:.1f} s ({result['cpu']:.1f} s), {result['gib']:.2f} GiB"


def main() -> None:
    """Measure all methods, and write the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--faces", type=int, nargs="+", default=[100_000])
    parser.add_argument(
        "--only",
        nargs="+",
        default=[name for name in registered() if find(name).function.__module__.startswith(baselines.__name__)],
    )
    parser.add_argument("--run")
    options = parser.parse_args()
    if options.run:
        print(json.dumps(run(options.run, options.faces[0])))
        return
    lines = [
        "# Time and memory of the methods",
        "",
        "Wall time, CPU time of all threads in brackets, and peak memory of the process. Each method runs at its "
        f"defaults on a torus with noise of {NOISE} mean edge lengths; {thread_count()} threads, {platform.machine()}, "
        f"Python {platform.python_version()}. `python -m benchmarks.speed.methods` writes this page.",
        "",
        "| method | " + " | ".join(f"{faces:,} faces" for faces in options.faces) + " |",
        "|---" * (1 + len(options.faces)) + "|",
    ]
    for name in options.only:
        lines.append(f"| `{name}` | " + " | ".join(measured(name, faces) for faces in options.faces) + " |")
        print(lines[-1], flush=True)
    (Path(__file__).parents[1] / "methods.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
