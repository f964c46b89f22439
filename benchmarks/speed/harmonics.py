"""Time the approximate eigenpairs of the Laplacian against those of Lanczos, and measure how far they are off.

python -m benchmarks.speed.harmonics [--vertices N ...] [--count K]

The meshes are those of benchmarks/speed/speed.py. Seconds are of the processor, all threads together, since they depend
less on what else the machine does. The table is printed, and written to benchmarks/harmonics.md.
"""

import argparse
import platform
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.speed.speed import wavy_torus
from cascadenorm.geometry.spectra.fast_harmonics import fast_harmonics
from cascadenorm.geometry.spectra.harmonics import Harmonics, manifold_harmonics
from cascadenorm.mesh import Mesh, thread_count

SIZES = (20_000, 50_000, 100_000, 500_000)  # vertices


class Comparison(NamedTuple):
    """Both ways on one mesh: processor seconds, and the largest relative errors of the approximate eigenvalues."""

    vertices: int
    exact_seconds: float
    fast_seconds: float
    lower_half_error: float
    largest_error: float

    @property
    def row(self) -> str:
        """A line of the table."""
        return (
            f"| {self.vertices:,} | {self.exact_seconds:.0f} | {self.fast_seconds:.1f} | "
            f"{self.exact_seconds / self.fast_seconds:.1f} | {100 * self.lower_half_error:.1f} % | "
            f"{100 * self.largest_error:.1f} % |"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare both on a mesh of each size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vertices", type=int, action="append", help="may be given several times")
    parser.add_argument("--count", type=int, default=500, help="eigenpairs")
    parser.add_argument("--output", type=Path, default=Path(__file__).parents[1] / "harmonics.md")
    chosen = parser.parse_args(arguments)
    fast_harmonics(torus_of(8000), 20)  # kernels are compiled once, and kept
    rows = []
    for vertices in chosen.vertices or SIZES:
        rows.append(compared(torus_of(vertices), chosen.count).row)
        print(rows[-1], flush=True)
    chosen.output.write_text(page(rows, chosen.count), encoding="utf-8")


def page(rows: Sequence[str], count: int) -> str:
    """Return the table with what it says."""
    machine = f"{thread_count()} threads, {platform.system()} {platform.machine()}, Python {platform.python_version()}"
    lines = [
        "# Eigenpairs of the Laplacian",
        "",
        f"The {count} lowest eigenpairs of the cotangent Laplacian: processor seconds of all threads together, kernels "
        f"compiled before, and relative errors of the approximate eigenvalues; {machine}. "
        "`python -m benchmarks.speed.harmonics` writes this page.",
        "",
        "| vertices | Lanczos | approximate | ratio | error of the lower half, at most | of all |",
        "| ---: | ---: | ---: | ---: | ---: | ---: |",
        *rows,
    ]
    return "\n".join(lines) + "\n"


def torus_of(vertices: int) -> Mesh:
    """Return a noisy torus of about so many vertices, half as many across as around."""
    across = round((vertices / 2) ** 0.5)
    return wavy_torus(2 * across, across)


def compared(mesh: Mesh, count: int) -> Comparison:
    """Compute the eigenpairs both ways; each starts without anything derived from the mesh."""
    fast_seconds, fast = timed(fast_harmonics, mesh, count)
    exact_seconds, exact = timed(manifold_harmonics, mesh, count)
    errors = fast.values[1:] / exact.values[1:] - 1  # the first is 0
    half = errors[: count // 2]
    return Comparison(len(mesh.vertices), exact_seconds, fast_seconds, float(half.max()), float(errors.max()))


def timed(function: Callable[[Mesh, int], Harmonics], mesh: Mesh, count: int) -> tuple[float, Harmonics]:
    """Return the processor seconds of a function on a fresh mesh, and its result."""
    fresh = Mesh(mesh.vertices, mesh.faces)
    start = time.process_time()
    found = function(fresh, count)
    return time.process_time() - start, found


if __name__ == "__main__":
    main()
