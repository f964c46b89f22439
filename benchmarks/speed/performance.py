"""Where the processor time of methods goes, kernel by kernel, against the speed of memory and of matrix products.

python -m benchmarks.speed.performance [--method NAME ...] [--environment DIR]

Denoises the torus of speed.py with a million faces on one thread, and writes benchmarks/performance.md and a flame
graph of each method beside it. It counts processor time, which depends less on what else the machine does than the time
that passes. py-spy, which samples the calls, is installed into an environment of its own.
"""

import argparse
import platform
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.speed.flame_graph import drawn, sampled
from benchmarks.speed.kernel_use import BLOCKS, Use, watched
from benchmarks.speed.speed import SIZES, wavy_torus
from cascadenorm import denoise
from cascadenorm.learned.methods import shipped
from cascadenorm.mesh import Mesh, one_blas_thread

PAGE = Path(__file__).parents[1] / "performance.md"
METHODS = ("auto", "bilateral-normal")
PROGRAM = """
from cascadenorm import denoise
from benchmarks.speed.speed import SIZES, wavy_torus
denoise(wavy_torus(*SIZES["1 M faces"]), method={method!r}, threads=1)
"""
LEAST = 0.01
"""Share of the time of a method from which a kernel has a row of its own."""


class Machine(NamedTuple):
    """What a thread reaches at best: gigabytes a second that a copy moves, GFLOP a second of a matrix product."""

    memory: float
    products: float


class Account(NamedTuple):
    """What a method did: its kernels, and processor time of all together."""

    uses: dict[str, Use]
    seconds: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure each method and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--method", action="append", help="may be given several times")
    parser.add_argument("--environment", type=Path, default=Path("build/peers"), help="of py-spy")
    chosen = parser.parse_args(arguments)
    machine = Machine(copy_speed(), product_speed())
    mesh = wavy_torus(*SIZES["1 M faces"])
    methods = chosen.method or METHODS
    sections = [section(name, account(mesh, name), len(mesh.faces), machine) for name in methods]
    for name in methods:
        stacks = sampled(PROGRAM.format(method=name), "denoise", chosen.environment)
        PAGE.with_name(picture(name)).write_text(drawn(stacks), encoding="utf-8")
    PAGE.write_text("\n".join([*head(machine), *sections]), encoding="utf-8")
    print(PAGE.read_text(encoding="utf-8"))


def account(mesh: Mesh, method: str) -> Account:
    """Denoise a mesh on one thread."""
    small = wavy_torus(40, 30)
    denoise(small, method=method, threads=1)  # kernels are compiled before
    with watched() as uses:
        before = time.process_time()
        denoise(mesh, method=method, threads=1)
        return Account(dict(uses), time.process_time() - before)


def section(method: str, done: Account, faces: int, machine: Machine) -> str:
    """Return the table of a method, its kernels by their time."""
    rows = sorted(done.uses.items(), key=lambda item: -item[1].seconds)
    large = [(name, use) for name, use in rows if use.seconds >= LEAST * done.seconds]
    rest = done.seconds - sum(use.seconds for _, use in large)
    lines = [
        f"## {method}",
        "",
        f"{1e6 * done.seconds / faces:.2f} µs a face.",
        "",
        "| kernel | rows a face | bytes a face | ns a face | share | speed | of the best |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
        *(row(name, use, faces, done.seconds, machine) for name, use in large),
        f"| the rest: numpy, Python, smaller kernels | | | {1e9 * rest / faces:.0f} | {rest / done.seconds:.0%} | | |",
        "",
        f"![Flame graph: the calls of {method}, each as wide as its share of the time]({picture(method)})",
        "",
    ]
    return "\n".join(lines)


def picture(method: str) -> str:
    """Name of the file with the flame graph of a method."""
    return f"performance-{method}.svg"


def row(name: str, use: Use, faces: int, total: float, machine: Machine) -> str:
    """Return the row of a kernel."""
    cells = [f"{1e9 * use.seconds / faces:.0f}", f"{use.seconds / total:.0%}"]
    if name == BLOCKS:
        speed = 1e-9 * network_operations() * faces / use.seconds
        speeds = f"{speed:.0f} GFLOP/s | {speed / machine.products:.0%}"
        return f"| networks of `auto`, in blocks | | | {' | '.join(cells)} | {speeds} |"
    speed = 1e-9 * use.bytes / use.seconds
    counts = [f"{use.rows / faces:.1f}", f"{use.bytes / faces:,.0f}"]
    return f"| `{name}` | {' | '.join(counts + cells)} | {speed:.1f} GB/s | {speed / machine.memory:.0%} |"


def network_operations() -> int:
    """Multiplications and additions a face of the matrix products in the stages of `auto`."""
    total = 0
    for stage in shipped("auto").surface.stages:
        sizes = [*(weight.shape[1] for weight, _ in stage.layers), stage.layers[-1][0].shape[2]]
        total += 2 * (stage.scaler.projection.size + sum(a * b for a, b in pairwise(sizes)))
    return total


def head(machine: Machine) -> list[str]:
    """Return what stands before the tables."""
    return [
        "# Where the time goes",
        "",
        "Processor time of methods on a torus of a million faces with noise, in memory, on one thread; "
        f"{platform.system()} {platform.machine()}, Python {platform.python_version()}. "
        "`python -m benchmarks.speed.performance` writes this page. "
        "Whole commands, with files and on all threads, are in "
        "[speed.md](speed.md).",
        "",
        "*Rows a face* counts the faces, vertices or edges that a kernel goes over in all its passes, for each face "
        "of the mesh. *Bytes a face* is the least that these passes move: each array that the kernel takes, once a "
        "pass. *Speed* divides it by the time. The best that a thread reaches here is "
        f"{machine.memory:.1f} GB/s for a copy of a large array and {machine.products:.0f} GFLOP/s for a product of "
        "large matrices in single precision. A kernel near the first one waits for memory, and would gain from fewer "
        "passes or smaller numbers alone; one far below it computes, or waits for neighbours that lie apart.",
        "",
        "In the flame graphs a call is as wide as its share of the time, and what it calls is below it. They show "
        "functions of Python; the time of a kernel is that of the function that runs it.",
        "",
        "`python -m benchmarks.speed.track` counts rows, bytes and memory on a small mesh, compares them with the last "
        "record in `benchmarks/records/track.json` and fails where one has grown; a test does the same.",
        "",
    ]  # fmt: skip


def copy_speed() -> float:
    """GB/s that a copy of 256 MB reads and writes."""
    values = np.ones(1 << 25)
    into = np.ones_like(values)
    return 2e-9 * values.nbytes / shortest(lambda: np.copyto(into, values))


def product_speed() -> float:
    """GFLOP/s of a product of square matrices in single precision."""
    matrix = np.ones((1024, 1024), np.float32)
    with one_blas_thread():
        return 2e-9 * 1024**3 / shortest(lambda: matrix @ matrix)


def shortest(work: Callable[[], object], times: int = 7) -> float:
    """Processor time of the fastest of several runs."""
    found = []
    for _ in range(times):
        before = time.thread_time()
        work()
        found.append(time.thread_time() - before)
    return min(found)


if __name__ == "__main__":
    main()
