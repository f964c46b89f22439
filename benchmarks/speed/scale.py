"""Measure large meshes in patches and batches of many files, and extrapolate to larger ones.

    python -m benchmarks.speed.scale meshes 1 4 [--memory 2GB] [--method auto] [--only-patches] [--record]
    python -m benchmarks.speed.scale files 10000 [--side 24] [--method auto] [--workers 2]
    python -m benchmarks.speed.scale plan [--core-hour 0.04] [--requests 0.005] [--record]

`meshes` denoises wavy, noisy sheets of so many million faces with and without `--memory`. Bytes a face are the peak of
the process, less that of denoising a few faces, over the faces. `files` says how much of the time of
`cascadenorm batch` goes into denoising many small files. `plan` computes what a million scans and a mesh of a billion
faces take, from the record of benchmarks/speed/commands.py; prices differ by provider and by year. The tables are those
of docs/patches.md and benchmarks/scale.md.
"""

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import results
from benchmarks.speed.commands import COMMAND, timed
from cascadenorm.api.patch_sizes import MAX_PATCH_FACES, PATCH_FACE_BYTES, WHOLE_FACE_BYTES
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh

FACE = np.dtype([("count", "u1"), ("corners", "<i4", (3,))])
FEW = 60
"""Squares along the side of the sheet that shows the base memory of a process."""
BYTES = 19
"""Bytes for each face in a binary PLY file: 13, plus 6 for half a vertex."""
REQUESTS = 8
"""Requests to an object store for a file that fits into one part; tests/batch/test_remote_files.py counts them."""
IN_PATCHES = "auto, cascade, bilateral-normal or guided-normal"
"""Methods whose memory in patches docs/patches.md states."""
SIZES = {"100 k faces": 1e5, "1 M faces": 1e6}
SCANS, SCAN, HUGE = 1e6, 2e5, 1e9
"""Scans and faces of each in the plan, and faces of the huge mesh."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure or plan."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    meshes = commands.add_parser("meshes", help="large meshes in patches")
    meshes.add_argument("millions", type=float, nargs="+", help="million faces")
    meshes.add_argument("--memory", default="2GB")
    meshes.add_argument("--only-patches", action="store_true", help="leave out runs without --memory")
    results.add_option(meshes, "large-meshes")
    files = commands.add_parser("files", help="a batch of many small files")
    files.add_argument("count", type=int)
    files.add_argument("--side", type=int, default=24, help="squares along a side; a file has 2 * side**2 faces")
    files.add_argument("--workers", type=int, default=2)
    for command in (meshes, files):
        command.add_argument("--method", default="auto")
    plan = commands.add_parser("plan", help="a million scans, and a billion faces")
    plan.add_argument("--core-hour", type=float, default=0.04, help="price of a core hour")
    plan.add_argument("--requests", type=float, default=0.005, help="price of a thousand requests to the store")
    results.add_option(plan, "plan")
    options = parser.parse_args(arguments)
    if options.command == "meshes":
        results.report(options.record, large_meshes(options), table)
    elif options.command == "files":
        print(many_files(options.count, options.side, options.method, options.workers))
    else:
        results.report(options.record, {"core_hour": options.core_hour, "requests": options.requests}, plan_table)


def large_meshes(options: argparse.Namespace) -> dict[str, Any]:
    """Denoise sheets with and without `--memory`. The figures of other methods in a record are kept."""
    runs: list[dict[str, Any]] = []
    if options.record:
        runs = [run for run in results.read(options.record)["runs"] if run["method"] != options.method]
    with tempfile.TemporaryDirectory() as folder:

        def denoised(side: int, memory: str | None) -> dict[str, Any]:
            source = Path(folder, f"{side}.ply")
            if not source.exists():
                write_sheet(source, side)
            words = [*COMMAND, "denoise", source, "-o", Path(folder, "out.ply"), "--force", "--method", options.method]
            run = timed([*words, *(("--memory", memory) if memory else ())])
            return {"peak": run.memory, "seconds": run.seconds, "processor": run.processor}

        least = denoised(FEW, None)["peak"]
        for millions in options.millions:
            side = round((millions * 1e6 / 2) ** 0.5)
            for memory in (options.memory,) if options.only_patches else (None, options.memory):
                found = denoised(side, memory)
                faces = 2 * side * side
                found |= {"method": options.method, "faces": faces, "memory": memory}
                runs.append({**found, "per_face": (found["peak"] - least) / faces})
                print(runs[-1], flush=True)
    return {"machine": results.machine(), "runs": runs}


def write_sheet(path: Path, side: int) -> None:
    """Write a sheet of 2 * side**2 faces, row by row."""
    rng = np.random.default_rng(0)
    x = np.arange(side + 1, dtype=np.float32)
    with path.open("wb") as file:
        file.write(
            f"ply\nformat binary_little_endian 1.0\nelement vertex {(side + 1) ** 2}\nproperty float x\n"
            f"property float y\nproperty float z\nelement face {2 * side * side}\n"
            "property list uchar int vertex_indices\nend_header\n".encode()
        )
        for y in range(side + 1):
            z = 20 * np.sin(x / 50) * np.cos(y / 70) + rng.normal(scale=0.2, size=len(x))
            np.stack([x, np.full_like(x, y), z.astype(np.float32)], axis=1).astype("<f4").tofile(file)
        corner = np.arange(side)
        for y in range(side):
            a = corner + y * (side + 1)
            rows = np.empty((side, 2), FACE)
            rows["count"] = 3
            rows["corners"][:, 0] = np.stack([a, a + 1, a + side + 2], axis=1)
            rows["corners"][:, 1] = np.stack([a, a + side + 2, a + side + 1], axis=1)
            rows.tofile(file)


def table(figures: results.Figures) -> str:
    """Return a row for each run on a large mesh."""
    titles = ("method", "million faces", "`--memory`", "peak, MB", "bytes a face", "seconds", "processor, s")
    rows = [
        [
            *(f"`{run['method']}`", f"{run['faces'] / 1e6:.1f}", run["memory"] or "–", f"{run['peak'] / 1e6:.0f}"),
            *(f"{run['per_face']:.0f}", f"{run['seconds']:.0f}", f"{run['processor']:.0f}"),
        ]
        for run in figures["runs"]
    ]
    return results.markdown(titles, rows)


def many_files(count: int, side: int, method: str, workers: int) -> str:
    """Denoise many small files, and describe where the time was spent."""
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scans").mkdir()
        for number in range(count):
            save_mesh(folder / "scans" / f"{number}.ply", sheet(side, rng))
        command = [*COMMAND, "batch", "scans", "-o", "out", "--method", method, "--workers", str(workers)]
        start = time.perf_counter()
        subprocess.run(command, cwd=folder, check=True)
        wall = time.perf_counter() - start
        lines = [json.loads(line) for line in (folder / "out" / "manifest.jsonl").read_text().splitlines()]
    return shares(lines, wall, workers)


def sheet(side: int, rng: np.random.Generator) -> Mesh:
    """Return a noisy sheet of 2 · side² faces."""
    y, x = np.mgrid[: side + 1, : side + 1]
    z = 0.1 * side * np.sin(4 * x / side) + rng.normal(scale=0.15, size=x.shape)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    a, b, c, d = corner, corner + 1, corner + side + 2, corner + side + 1
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh(np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1), faces)


def shares(lines: list[dict[str, Any]], wall: float, workers: int) -> str:
    """Return how the time is divided, without the first files of each process, which load libraries and compile."""
    ended = [(datetime.fromisoformat(line["time"]).timestamp(), line) for line in lines if line["status"] == "done"]
    begin, steady = ended[4 * workers][0], [line for _, line in ended[4 * workers + 1 :]]
    span = workers * (ended[-1][0] - begin)
    denoising = sum(line["summary"]["seconds"] for line in steady)
    working = sum(line["seconds"] for line in steady)
    return (
        f"{len(ended)} files of {ended[0][1]['summary']['faces']} faces in {wall:.1f} s, {workers} processes. "
        f"Once they run, denoising takes {denoising / span:.1%} of their time, reading, digests and writing "
        f"{(working - denoising) / span:.1%}, waiting {1 - working / span:.1%}."
    )


class Rate(NamedTuple):
    """Cost of a method: seconds on all threads = start + slope · faces; memory in bytes a face, at most."""

    start: float
    slope: float
    memory: float


def rates(commands: results.Figures) -> dict[str, Rate]:
    """Return the rate of each method that was measured at both sizes."""
    found = {(run["name"], run["size"]): run for run in commands["runs"]}
    (short, few), (long, many) = SIZES.items()
    rated = {}
    for name, size in found:
        if size == long and (name, short) in found and not name.startswith("PyMeshLab"):
            before, after = found[name, short], found[name, long]
            slope = (after["seconds"] - before["seconds"]) / (many - few)
            memory = after["gibibytes"] * 2**30 / many
            rated[name] = Rate(max(0.0, before["seconds"] - slope * few), slope, memory)
    return rated


def plan_table(prices: results.Figures) -> str:
    """Return the tables of many scans and of one huge mesh, with their assumptions."""
    commands = results.read("commands")
    threads, methods = commands["threads"], rates(commands)
    size = BYTES * SCAN / 1e6
    return "\n\n".join(
        [
            f"### {SCANS:,.0f} scans of {SCAN:,.0f} faces",
            f"{size:.1f} MB each as binary PLY: {SCANS * size / 1e6:.1f} TB to read, as much to write. "
            f"Cores at {prices['core_hour']:g} an hour, requests at {prices['requests']:g} a thousand.",
            scans_table(threads, methods, SCANS, SCAN, prices["core_hour"], prices["requests"]),
            f"### One mesh of {HUGE:,.0f} faces",
            f"{BYTES * HUGE / 1e9:.0f} GB as binary PLY. On {threads} threads.",
            huge_table(methods, HUGE),
        ]
    )


def scans_table(threads: int, methods: dict[str, Rate], scans: float, faces: float, price: float, fee: float) -> str:
    """Return rows for a number of scans, given the price of a core hour and of a thousand requests."""
    titles = ["method", "core hours", "hours on 1,000 cores", "GB of memory a process", "cost of cores", "of requests"]
    rows = []
    for name, rate in methods.items():
        hours = threads * scans * faces * rate.slope / 3600
        memory = rate.memory * faces / 1e9
        requests = REQUESTS * scans / 1000 * fee
        rows.append(
            [name, f"{hours:,.0f}", f"{hours / 1000:.1f}", f"{memory:.2f}", f"{hours * price:,.0f}", f"{requests:,.0f}"]
        )
    return results.markdown(titles, rows)


def huge_table(methods: dict[str, Rate], faces: float) -> str:
    """Return rows for one mesh with a number of faces, in memory and in patches."""
    rows = []
    for name, rate in methods.items():
        hours, memory = (rate.start + rate.slope * faces) / 3600, rate.memory * faces / 1e9
        rows.append([f"{name}, in memory", f"{hours:.1f}", f"{memory:,.0f}"])
    memory = WHOLE_FACE_BYTES * faces + PATCH_FACE_BYTES * MAX_PATCH_FACES
    rows.append([f"{IN_PATCHES}, in patches", "–", f"{memory / 1e9:,.0f}"])
    return results.markdown(["how", "hours", "memory, GB"], rows)


if __name__ == "__main__":
    main()
