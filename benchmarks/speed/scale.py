"""What a million scans and a billion faces take, from figures that were measured, into benchmarks/scale.md.

    python -m benchmarks.speed.scale

Reads benchmarks/speed.md (seconds of whole commands at two sizes). The formulas are in the page. Prices are arguments:
they differ by provider and by year.
"""

import argparse
import re
from dataclasses import dataclass
from pathlib import Path

from cascadenorm.patches.planning import LARGEST, PATCH, WHOLE

ROOT = Path(__file__).parents[2]
SPEED, PAGE = ROOT / "benchmarks" / "speed.md", ROOT / "benchmarks" / "scale.md"
BEGIN, END = "<!-- figures: written by benchmarks/speed/scale.py -->", "<!-- end of figures -->"

BYTES = 19
"""Bytes of a face in a binary PLY file: 13, and half a vertex of 12."""

REQUESTS = 8
"""Requests to a store for a file that fits into one part; tests/batch/test_remote_files.py counts them."""

IN_PATCHES = "auto, cascade, bilateral-normal or guided-normal"
"""Methods whose memory in patches docs/patches.md states."""

SIZES = {"100 k": 1e5, "1 M": 1e6}


@dataclass(frozen=True)
class Rate:
    """Cost of a method: seconds on all threads = start + slope · faces; memory in bytes a face, at most."""

    start: float
    slope: float
    memory: float


def rates(page: str) -> tuple[int, dict[str, Rate]]:
    """Threads, and the rate of each method that was measured at both sizes."""
    threads = re.search(r"(\d+) threads", page)
    assert threads, "the page of times does not say how many threads"
    rows = re.findall(r"^\| (\S+), (100 k|1 M) faces \| ([\d.]+) \| ([\d.]+) \|$", page, re.MULTILINE)
    found = {(name, SIZES[size]): (float(seconds), float(memory)) for name, size, seconds, memory in rows}
    few, many = SIZES.values()
    result = {}
    for name in [name for name, size in found if size == many and (name, few) in found]:
        (short, _), (long, memory) = found[name, few], found[name, many]
        slope = (long - short) / (many - few)
        result[name] = Rate(max(0.0, short - slope * few), slope, memory * 2**30 / many)
    return int(threads[1]), result


def scans_table(threads: int, methods: dict[str, Rate], scans: float, faces: float, price: float, fee: float) -> str:
    """Rows for so many scans, at a price of a core hour and of a thousand requests."""
    lines = ["| method | core hours | hours on 1,000 cores | GB of memory a process | cost of cores | of requests |"]
    lines.append("| --- | ---: | ---: | ---: | ---: | ---: |")
    for name, rate in methods.items():
        hours = threads * scans * faces * rate.slope / 3600
        memory = rate.memory * faces / 1e9
        requests = REQUESTS * scans / 1000 * fee
        lines.append(
            f"| {name} | {hours:,.0f} | {hours / 1000:.1f} | {memory:.2f} | {hours * price:,.0f} | {requests:,.0f} |"
        )
    return "\n".join(lines)


def large_table(methods: dict[str, Rate], faces: float) -> str:
    """Rows for one mesh of so many faces, in memory and in patches."""
    lines = ["| how | hours | memory, GB |", "| --- | ---: | ---: |"]
    for name, rate in methods.items():
        hours, memory = (rate.start + rate.slope * faces) / 3600, rate.memory * faces / 1e9
        lines.append(f"| {name}, in memory | {hours:.1f} | {memory:,.0f} |")
    lines.append(f"| {IN_PATCHES}, in patches | – | {(WHOLE * faces + PATCH * LARGEST) / 1e9:,.0f} |")
    return "\n".join(lines)


def figures(speed: str, price: float, fee: float) -> str:
    """The tables with what they assume."""
    threads, methods = rates(speed)
    scans, faces, huge = 1e6, 2e5, 1e9
    each = BYTES * faces / 1e6
    return "\n\n".join(
        (
            f"### {scans:,.0f} scans of {faces:,.0f} faces",
            f"{each:.1f} MB each as binary PLY: {scans * each / 1e6:.1f} TB to read, as much to write. "
            f"Cores at {price:g} an hour, requests at {fee:g} a thousand.",
            scans_table(threads, methods, scans, faces, price, fee),
            f"### One mesh of {huge:,.0f} faces",
            f"{BYTES * huge / 1e9:.0f} GB as binary PLY. On {threads} threads.",
            large_table(methods, huge),
        )
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--core-hour", type=float, default=0.04, help="price of a core hour")
    parser.add_argument("--requests", type=float, default=0.005, help="price of a thousand requests to the store")
    options = parser.parse_args()
    text = figures(SPEED.read_text(encoding="utf-8"), options.core_hour, options.requests)
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    PAGE.write_text(f"{head}{BEGIN}\n\n{text}\n\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main()
