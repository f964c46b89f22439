"""Measure the kernels of methods: the time of each, and the number of passes over the mesh.

    python -m benchmarks.speed.kernels times [--method NAME ...] [--environment DIR] [--record]
    python -m benchmarks.speed.kernels counts [--record REASON]

`times` measures where the processor time of methods goes, against the speed of memory and matrix products. It denoises
a torus of a million faces on one thread, and counts processor time, which depends less on what else the machine does
than wall time. With `--record` it also draws a flame graph of each method beside benchmarks/performance.md, where the
tables are; py-spy, which samples the calls, is installed into an environment of its own.

`counts` counts passes, bytes and memory, which tell on any machine whether a method became slower. It compares with the
last record and fails where a count has grown; `--record` appends a record to benchmarks/records/track.json.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
import tracemalloc
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import results
from benchmarks.environments import interpreter
from benchmarks.speed.meshes import MILLION, wavy_torus
from cascadenorm import denoise
from cascadenorm.learned.methods import shipped
from cascadenorm.mesh import Mesh, in_blocks, one_blas_thread, parallel_for

METHODS = ("auto", "bilateral-normal")
PROGRAM = """
from benchmarks.speed.meshes import MILLION, wavy_torus
from cascadenorm import denoise
denoise(wavy_torus(*MILLION), method={method!r}, threads=1)
"""
LEAST = 0.01
"""Smallest fraction of the time of a method for a kernel to have its own row."""
BLOCKS = "matrix products in blocks"
"""Label of the calls of `in_blocks`, without the kernels that they call."""
TITLES = ("kernel", "rows a face", "bytes a face", "ns a face", "share", "speed", "of the best")

# of flame graphs
RATE = 100
"""Samples a second."""
WIDTH, HEIGHT, LETTER = 1200, 18, 6.6
"""Width of the picture, height of a call and width of a letter, in pixels."""
LEAST_DRAWN = 0.003
"""Smallest fraction of the time for a call to be drawn."""
COLORS = ("#f4a261", "#e9c46a", "#f6bd60", "#f28482")

# of counts
HISTORY = results.ROOT / results.FOLDER / "track.json"
COUNTED = ("auto", "cascade", "bilateral-normal", "guided-normal", "tv-normal", "l0", "taubin")
COUNTED_SIZE = 100, 50
"""Steps of the torus: 10,000 faces."""
TOLERANCE = {"rows a face": 0.001, "bytes a face": 0.01, "memory, bytes a face": 0.05}
"""Relative increase of a count that is allowed. Memory depends slightly on the version of Python."""

Stack = tuple[str, ...]
Counts = dict[str, float]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure or count; return 1 if a count has increased."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    times = commands.add_parser("times", help="of each kernel")
    times.add_argument("--method", action="append", help="may be given several times")
    times.add_argument("--environment", type=Path, default=Path("build/peers"), help="of py-spy")
    results.add_option(times, "kernels")
    counts = commands.add_parser("counts", help="of passes, bytes and memory")
    counts.add_argument("--record", metavar="REASON", help="why the counts are as they are now")
    options = parser.parse_args(arguments)
    if options.command == "counts":
        return tracked(options.record)
    methods = options.method or METHODS
    best = {"memory": copy_speed(), "products": product_speed()}
    mesh = wavy_torus(*MILLION)
    figures = {
        "machine": f"1 of {results.machine()}",
        "best": best,
        "methods": {name: account(mesh, name) for name in methods},
    }
    if options.record:
        for name in methods:
            stacks = sampled(PROGRAM.format(method=name), "denoise", options.environment)
            (results.ROOT / "benchmarks" / picture(name)).write_text(drawn(stacks), encoding="utf-8")
    results.report(options.record, figures, table)
    return 0


@dataclass
class Use:
    """Calls, time and memory traffic of a kernel.

    Parameters
    ----------
    rows
        Faces, vertices or edges that it went over, all passes together.
    bytes
        Least that it reads and writes: each array once a pass, as far as the pass goes over it.
    times
        Processor time of each call, in seconds.
    """

    rows: int = 0
    bytes: float = 0.0
    times: list[float] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Processor time of all threads."""
        return sum(self.times)


class _Clock(threading.local):
    """Processor time of the calls inside the current one, for each thread."""

    inner = 0.0


@contextmanager
def watched() -> Iterator[dict[str, Use]]:
    """Record the kernels called inside the block by module and name."""
    uses: dict[str, Use] = defaultdict(Use)
    clock = _Clock()

    def timed(use: Use, work: Callable[..., Any]) -> Callable[..., Any]:
        def done(*arguments: Any) -> Any:
            before, outer, clock.inner = time.thread_time(), clock.inner, 0.0
            try:
                return work(*arguments)
            finally:
                spent = time.thread_time() - before
                use.times.append(spent - clock.inner)
                clock.inner = outer + spent

        return done

    def over_ranges(count: int, run: Callable[..., Any], *arguments: Any, **settings: Any) -> Any:
        name = f"{run.__module__.removeprefix('cascadenorm.')}.{run.__name__.strip('_')}"
        use = uses[name]
        use.rows += count
        use.bytes += least_bytes(count, arguments)
        return parallel_for(count, timed(use, run), *arguments, **settings)

    def over_blocks(count: int, run: Callable[..., Any]) -> Any:
        use = uses[BLOCKS]
        use.rows += count
        return in_blocks(count, timed(use, run))

    replaced = {parallel_for: over_ranges, in_blocks: over_blocks}
    modules = [module for name, module in sys.modules.items() if name.startswith("cascadenorm.")]
    places = [(vars(m), key, value) for m in modules for key, value in vars(m).items() if _is_key(value, replaced)]
    try:
        for names, key, value in places:
            names[key] = replaced[value]
        yield uses
    finally:
        for names, key, value in places:
            names[key] = value


def _is_key(value: object, keys: dict[Any, Any]) -> bool:
    return any(value is key for key in keys)


def least_bytes(count: int, arguments: tuple[Any, ...]) -> float:
    """Return the least traffic of a pass over `count` rows: its arrays, or the part of them that it covers."""
    arrays = {id(a): a for argument in arguments for a in _arrays(argument)}.values()
    lengths = [len(a) for a in arrays if a.ndim > 1 and a.dtype.kind == "f"]
    return sum(a.nbytes for a in arrays) * min(1.0, count / max(1, min(lengths, default=count)))


def _arrays(argument: Any) -> list[np.ndarray[Any, Any]]:
    if isinstance(argument, np.ndarray):
        return [argument]
    return [a for a in argument if isinstance(a, np.ndarray)] if isinstance(argument, tuple) else []


def account(mesh: Mesh, method: str) -> dict[str, Any]:
    """Denoise a mesh on one thread; return nanoseconds a face in all, and the figures of each large kernel."""
    denoise(wavy_torus(40, 30), method=method, threads=1)  # kernels are compiled before
    with watched() as uses:
        before = time.process_time()
        denoise(mesh, method=method, threads=1)
        seconds = time.process_time() - before
    large = sorted((use.seconds, name) for name, use in uses.items() if use.seconds >= LEAST * seconds)
    kernels = [figures_of(name, uses[name], len(mesh.faces)) for _, name in reversed(large)]
    return {"nanoseconds": 1e9 * seconds / len(mesh.faces), "kernels": kernels}


def figures_of(name: str, use: Use, faces: int) -> dict[str, Any]:
    """Return the work of a kernel for each face and its speed in GB/s, or GFLOP/s for networks."""
    if name == BLOCKS:
        speed = 1e-9 * network_operations() * faces / use.seconds
        return {"name": None, "nanoseconds": 1e9 * use.seconds / faces, "speed": speed}
    return {
        "name": name,
        "rows": use.rows / faces,
        "bytes": use.bytes / faces,
        "nanoseconds": 1e9 * use.seconds / faces,
        "speed": 1e-9 * use.bytes / use.seconds,
    }


def network_operations() -> int:
    """Return the multiplications and additions a face of the matrix products in the stages of `auto`."""
    total = 0
    for stage in shipped("auto").surface.stages:
        sizes = [*(weight.shape[1] for weight, _ in stage.layers), stage.layers[-1][0].shape[2]]
        total += 2 * (stage.scaler.projection.size + sum(a * b for a, b in pairwise(sizes)))
    return total


def copy_speed() -> float:
    """Return the GB/s that a copy of 256 MB reads and writes."""
    values = np.ones(1 << 25)
    into = np.ones_like(values)
    return 2e-9 * values.nbytes / shortest(lambda: np.copyto(into, values))


def product_speed() -> float:
    """Return the GFLOP/s of a product of square matrices in single precision."""
    matrix = np.ones((1024, 1024), np.float32)
    with one_blas_thread():
        return 2e-9 * 1024**3 / shortest(lambda: matrix @ matrix)


def shortest(work: Callable[[], object], times: int = 7) -> float:
    """Return the processor time of the fastest of several runs."""
    found = []
    for _ in range(times):
        before = time.thread_time()
        work()
        found.append(time.thread_time() - before)
    return min(found)


def table(figures: results.Figures) -> str:
    """Return the highest speed of a thread, and a section for each method with a row for each kernel."""
    best = figures["best"]
    parts = [
        f"{figures['machine']}. The best that a thread reaches here is {best['memory']:.1f} GB/s for a copy of a large "
        f"array and {best['products']:.0f} GFLOP/s for a product of large matrices in single precision."
    ]
    for method, done in figures["methods"].items():
        total = done["nanoseconds"]
        rest = total - sum(kernel["nanoseconds"] for kernel in done["kernels"])
        cells = ["the rest: numpy, Python, smaller kernels", "", "", f"{rest:.0f}", f"{rest / total:.0%}", "", ""]
        rows = [*(_row(kernel, total, best) for kernel in done["kernels"]), cells]
        parts += [
            f"## {method}",
            f"{total / 1000:.2f} µs a face.",
            results.markdown(TITLES, rows),
            f"![Flame graph: the calls of {method}, each as wide as its share of the time]({picture(method)})",
        ]
    return "\n\n".join(parts)


def _row(kernel: dict[str, Any], total: float, best: dict[str, float]) -> list[str]:
    speed, times = kernel["speed"], [f"{kernel['nanoseconds']:.0f}", f"{kernel['nanoseconds'] / total:.0%}"]
    if kernel["name"] is None:
        return [
            "networks of `auto`, in blocks",
            "",
            "",
            *times,
            f"{speed:.0f} GFLOP/s",
            f"{speed / best['products']:.0%}",
        ]
    counts = [f"{kernel['rows']:.1f}", f"{kernel['bytes']:,.0f}"]
    return [f"`{kernel['name']}`", *counts, *times, f"{speed:.1f} GB/s", f"{speed / best['memory']:.0%}"]


def picture(method: str) -> str:
    """Return the name of the file with the flame graph of a method."""
    return f"performance-{method}.svg"


class Call(NamedTuple):
    """A rectangle of the picture: a call, its depth, and its begin and end in samples."""

    name: str
    depth: int
    begin: int
    end: int


def sampled(program: str, first: str, environment: Path) -> Counter[Stack]:
    """Run a Python program; count by py-spy how often each stack of functions was seen, from the function `first` on.

    Parameters
    ----------
    environment
        Where py-spy is, or is installed.
    """
    python = interpreter(environment, ["py-spy"])
    with tempfile.TemporaryDirectory() as name:
        found = Path(name, "stacks.txt")
        recorder = [str(python.with_name("py-spy")), "record", "--rate", str(RATE), "--function", "--format", "raw"]
        command = [*recorder, "--output", str(found), "--", sys.executable, "-c", program]
        subprocess.run(command, check=True, capture_output=True, cwd=Path(__file__).parents[2])
        lines = found.read_text(encoding="utf-8").splitlines()
    counted: Counter[Stack] = Counter()
    for line in lines:
        frames, _, count = line.rpartition(" ")
        names = [frame.partition(" (")[0] for frame in frames.split(";") if "/mesh/thread" not in frame]
        if first in names:
            counted[tuple(names[names.index(first) :])] += int(count)
    return counted


def calls(stacks: Counter[Stack], depth: int = 0, begin: int = 0) -> list[Call]:
    """Return the calls at a depth, for stacks with equal callers, and all calls below them, longest first."""
    inside: dict[str, Counter[Stack]] = {}
    for stack, count in stacks.items():
        if len(stack) > depth:
            inside.setdefault(stack[depth], Counter())[stack] = count
    found = []
    for name, those in sorted(inside.items(), key=lambda item: (-item[1].total(), item[0])):
        found += [Call(name, depth, begin, begin + those.total()), *calls(those, depth + 1, begin)]
        begin += those.total()
    return found


def drawn(stacks: Counter[Stack]) -> str:
    """Return an SVG picture. The width of a call is its fraction of the time; its callees are below it."""
    total = stacks.total()
    large = [call for call in calls(stacks) if call.end - call.begin >= LEAST_DRAWN * total]
    height = HEIGHT * (1 + max(call.depth for call in large))
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="monospace" '
        'font-size="11">'
    ]
    for call in large:
        x, width = WIDTH * call.begin / total, WIDTH * (call.end - call.begin) / total
        y, share = HEIGHT * call.depth, (call.end - call.begin) / total
        letters = int((width - 4) / LETTER)
        shown = call.name if len(call.name) <= letters else f"{call.name[: letters - 1]}…" if letters > 3 else ""
        lines += [
            f"<g><title>{escape(call.name)}, {share:.1%}</title>"
            f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{HEIGHT - 1}" '
            f'fill="{COLORS[sum(map(ord, call.name)) % len(COLORS)]}"/>'
            f'<text x="{x + 3:.1f}" y="{y + 13}">{escape(shown)}</text></g>'
        ]
    return "\n".join([*lines, "</svg>", ""])


def tracked(reason: str | None) -> int:
    """Count, compare, and record if there is a reason; return 1 if a count has grown."""
    mesh = wavy_torus(*COUNTED_SIZE)
    found = {method: counted(mesh, method) for method in COUNTED}
    history = json.loads(HISTORY.read_text(encoding="utf-8")) if HISTORY.exists() else []
    messages = grown(history[-1]["counts"], found) if history else []
    print(*messages or ["no count has grown"], sep="\n")
    if reason:
        history.append({"reason": reason, "counts": found})
        HISTORY.write_text(json.dumps(history, indent=1) + "\n", encoding="utf-8")
        return 0
    return 1 if messages else 0


def counted(mesh: Mesh, method: str) -> Counts:
    """Denoise a mesh on one thread and return the counts."""
    faces = len(mesh.faces)
    denoise(mesh, method=method, threads=1)  # whatever is compiled or loaded once
    with watched() as uses:
        tracemalloc.start()
        denoise(Mesh(mesh.vertices, mesh.faces), method=method, threads=1)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    return {
        "rows a face": round(sum(use.rows for use in uses.values()) / faces, 3),
        "bytes a face": round(sum(use.bytes for use in uses.values()) / faces),
        "memory, bytes a face": round(peak / faces),
    }


def grown(before: dict[str, Counts], now: dict[str, Counts]) -> list[str]:
    """Describe the counts that have increased by more than their tolerance."""
    return [
        f"{method}: {name} {before[method][name]:,} -> {count:,}"
        for method, counts in now.items()
        for name, count in counts.items()
        if method in before and count > before[method][name] * (1 + TOLERANCE[name])
    ]


if __name__ == "__main__":
    sys.exit(main())
