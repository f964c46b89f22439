"""Time and memory of a large mesh in patches, beside the whole mesh, into docs/patches.md.

    python -m benchmarks.speed.patches 1 4 --memory 3GB --method auto --write

makes a wavy, noisy sheet of so many million faces as a binary PLY file, and denoises it in a process of its own, with
and without `--memory`. Peaks are the largest resident memory of that process; bytes a face are that less the peak of
denoising a sheet of a few faces, over the faces. `--write` replaces the rows of the same method in the page.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

PAGE = Path(__file__).parents[2] / "docs" / "patches.md"
BEGIN, END = "<!-- memory: written by benchmarks/speed/patches.py -->", "<!-- end of memory -->"
TITLES = ("method", "million faces", "`--memory`", "peak, MB", "bytes a face", "seconds", "processor, s")
FACE = np.dtype([("count", "u1"), ("corners", "<i4", (3,))])


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


def measured(side: int, method: str, memory: str | None, folder: Path) -> tuple[float, float, float]:
    """Denoise a sheet in a process; return its peak in bytes, the seconds, and those of the processor."""
    source = folder / f"{side}.ply"
    if not source.exists():
        write_sheet(source, side)
    command = [sys.executable, "-m", "cascadenorm", "denoise", str(source), "-o", str(folder / "out.ply"), "--force"]
    command += ["--method", method, *(("--memory", memory) if memory else ())]
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"the run ended with status {status}")
    return used.ru_maxrss * 1024, time.perf_counter() - start, used.ru_utime + used.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("millions", type=float, nargs="+", help="million faces")
    parser.add_argument("--memory", default="2GB")
    parser.add_argument("--method", default="auto")
    parser.add_argument("--only-patches", action="store_true", help="leave out the whole mesh")
    parser.add_argument("--write", action="store_true", help="write the table into docs/patches.md")
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        few, _, _ = measured(60, options.method, None, Path(name))
        for millions in options.millions:
            side = round((millions * 1e6 / 2) ** 0.5)
            for memory in (options.memory,) if options.only_patches else (None, options.memory):
                peak, seconds, processor = measured(side, options.method, memory, Path(name))
                each = (peak - few) / (2 * side * side)
                cells = (
                    f"`{options.method}`", f"{2 * side * side / 1e6:.1f}", memory or "–", f"{peak / 1e6:.0f}",
                    f"{each:.0f}", f"{seconds:.0f}", f"{processor:.0f}",
                )  # fmt: skip
                rows.append(f"| {' | '.join(cells)} |")
                print(rows[-1], flush=True)
    if options.write:
        before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
        table, after = rest.split(END)
        kept = [line for line in table.splitlines()[3:] if line and not line.startswith(f"| `{options.method}` |")]
        lines = [f"| {' | '.join(TITLES)} |", f"| --- |{' ---: |' * (len(TITLES) - 1)}", *kept, *rows]
        PAGE.write_text(f"{before}{BEGIN}\n" + "".join(f"{line}\n" for line in lines) + END + after, encoding="utf-8")


if __name__ == "__main__":
    main()
