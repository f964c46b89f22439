"""Time and memory of files larger than memory, under a hard limit, into docs/patches.md.

    python benchmarks/streaming.py 10 --memory 1GB --limit 1.5GB --method bilateral-normal --set iterations=10

makes a wavy, noisy sheet of so many million faces as a binary PLY file, block by block, and denoises it in a process
of its own. `--write` puts the rows in place of those of the same method; rows of others stay.

`--limit` is a limit of the operating system on the data of that process (RLIMIT_DATA: all private memory that it asks
for, used or not), beyond which it would end. The peak of resident memory is that which the kernel reports for the
process; it includes pages of files that are mapped, which the kernel may drop. Scratch is the largest size that the
folder beside the output was seen to have.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from cascadenorm.execution.memory import memory_size

PAGE = Path(__file__).parents[1] / "docs" / "patches.md"
BEGIN, END = "<!-- large files: written by benchmarks/streaming.py -->", "<!-- end of large files -->"
TITLES = (
    "method", "million faces", "file, MB", "`--memory`", "hard limit", "peak, MB", "processor, s", "seconds",
    "read, MB", "written, MB", "scratch, MB",
)  # fmt: skip
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("millions", type=float, nargs="+", help="million faces")
    parser.add_argument("--memory", default="1GB")
    parser.add_argument("--limit", default="2GB")
    parser.add_argument("--method", default="auto")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter of the method")
    parser.add_argument("--folder", type=Path, help="where the files go, some ten times their size")
    parser.add_argument("--write", action="store_true", help="write the table into docs/patches.md")
    options = parser.parse_args()
    rows = [measured(millions, options) for millions in options.millions]
    print("\n".join(rows))
    if options.write:
        text = PAGE.read_text(encoding="utf-8")
        before, rest = text.split(BEGIN)
        table, after = rest.split(END)
        kept = [line for line in table.splitlines()[3:] if line and not line.startswith(f"| {named(options)} |")]
        lines = [f"| {' | '.join(TITLES)} |", f"| --- |{' ---: |' * (len(TITLES) - 1)}", *kept, *rows]
        PAGE.write_text(f"{before}{BEGIN}\n" + "".join(f"{line}\n" for line in lines) + END + after, encoding="utf-8")


def named(options: argparse.Namespace) -> str:
    """The method and its parameters as the table has them."""
    return ", ".join([f"`{options.method}`", *(given.replace("=", " ") for given in options.set)])


def measured(millions: float, options: argparse.Namespace) -> str:
    """Denoise one sheet and return a row of the table."""
    side = round((millions * 1e6 / 2) ** 0.5)
    limit = memory_size("limit", options.limit)
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        source, output = Path(name, "sheet.ply"), Path(name, "smooth.ply")
        write_sheet(source, side)
        command = [sys.executable, "-m", "cascadenorm", "denoise", str(source), "-o", str(output)]
        command += ["--method", options.method, "--memory", options.memory]
        command += [word for given in options.set for word in ("--set", given)]
        start = time.perf_counter()
        process = subprocess.Popen(command, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (limit, limit)))
        scratch, ended = 0, 0
        while not ended:
            ended, status, used = os.wait4(process.pid, os.WNOHANG)
            scratch = max(scratch, size_of(output.with_name(f".{output.name}.parts")))
            time.sleep(0.1)
        seconds = time.perf_counter() - start
        if status:
            raise SystemExit(f"the run ended with status {status}")
        assert output.stat().st_size == source.stat().st_size
        size = source.stat().st_size
    cells = (
        named(options),
        f"{2 * side * side / 1e6:.1f}",
        f"{size / 1e6:.0f}",
        options.memory,
        options.limit,
        f"{used.ru_maxrss * 1024 / 1e6:.0f}",
        f"{used.ru_utime + used.ru_stime:.0f}",
        f"{seconds:.0f}",
        f"{used.ru_inblock * 512 / 1e6:.0f}",
        f"{used.ru_oublock * 512 / 1e6:.0f}",
        f"{scratch / 1e6:.0f}",
    )
    return f"| {' | '.join(cells)} |"


def size_of(folder: Path) -> int:
    """Bytes of the files in a folder, some of which may just be removed."""
    size = 0
    for path in folder.glob("*"):
        with suppress(FileNotFoundError):
            size += path.stat().st_size
    return size


if __name__ == "__main__":
    main()
