"""How much of the time of `cascadenorm batch` goes into denoising, with many small files.

    python -m benchmarks.speed.batch 10000

The share is that of the methods' own seconds in all seconds of the processes, from when the first file begins; the
rest is reading, digests, writing and waiting for the next file. Starting the processes and compiling come once, and are
given apart.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from datetime import datetime
from pathlib import Path

import numpy as np

from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh


def sheet(side: int, rng: np.random.Generator) -> Mesh:
    """Return a noisy sheet of 2 · side² faces."""
    y, x = np.mgrid[: side + 1, : side + 1]
    z = 0.1 * side * np.sin(4 * x / side) + rng.normal(scale=0.15, size=x.shape)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    a, b, c, d = corner, corner + 1, corner + side + 2, corner + side + 1
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh(np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1), faces)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int)
    parser.add_argument("--side", type=int, default=24, help="squares along a side; a file has 2 * side**2 faces")
    parser.add_argument("--method", default="auto")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scans").mkdir()
        for number in range(options.count):
            save_mesh(folder / "scans" / f"{number}.ply", sheet(options.side, rng))
        command = ["-m", "cascadenorm", "batch", "scans", "-o", "out", "--method", options.method]
        start = time.perf_counter()
        subprocess.run([sys.executable, *command, "--workers", str(options.workers)], cwd=folder, check=True)
        wall = time.perf_counter() - start
        lines = [json.loads(line) for line in (folder / "out" / "manifest.jsonl").read_text().splitlines()]
    report(lines, wall, options.workers)


def report(lines: list[dict], wall: float, workers: int) -> None:
    """Print where the time went, leaving out the first files of each process, which load and compile."""
    ended = [(datetime.fromisoformat(line["time"]).timestamp(), line) for line in lines if line["status"] == "done"]
    begin, steady = ended[4 * workers][0], [line for _, line in ended[4 * workers + 1 :]]
    span = workers * (ended[-1][0] - begin)
    inside = sum(line["summary"]["seconds"] for line in steady)
    process = sum(line["seconds"] for line in steady)
    print(f"{len(ended)} files of {ended[0][1]['summary']['faces']} faces in {wall:.1f} s, {workers} processes")
    print(f"denoising {100 * inside / span:.1f} % of the time of the processes once they run")
    print(
        f"reading, digests, writing {100 * (process - inside) / span:.1f} %, waiting {100 * (1 - process / span):.1f} %"
    )


if __name__ == "__main__":
    main()
