"""Time the approximate eigenpairs of the Laplacian against those of Lanczos, and measure their errors.

    python -m benchmarks.speed.harmonics [--vertices N ...] [--count 500] [--record]

Seconds are of the processor, all threads together, since they depend less on what else the machine does. The table is
that of benchmarks/speed.md.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from typing import Any

from benchmarks import results
from benchmarks.speed.meshes import wavy_torus
from cascadenorm.geometry.spectra.fast_harmonics import fast_harmonics
from cascadenorm.geometry.spectra.harmonics import Harmonics, manifold_harmonics
from cascadenorm.mesh import Mesh

SIZES = (20_000, 50_000, 100_000, 500_000)
TITLES = ("vertices", "Lanczos", "approximate", "ratio", "error of the lower half, at most", "of all")


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare both on a mesh of each size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vertices", type=int, action="append", help="may be given several times")
    parser.add_argument("--count", type=int, default=500, help="eigenpairs")
    results.add_option(parser, "harmonics")
    options = parser.parse_args(arguments)
    fast_harmonics(torus_of(8000), 20)  # kernels are compiled once, and kept
    meshes = []
    for vertices in options.vertices or SIZES:
        meshes.append(compared(torus_of(vertices), options.count))
        print(meshes[-1], flush=True)
    figures = {"machine": results.machine(), "count": options.count, "meshes": meshes}
    results.report(options.record, figures, table)


def torus_of(vertices: int) -> Mesh:
    """Return a noisy torus of about so many vertices, half as many across as around."""
    across = round((vertices / 2) ** 0.5)
    return wavy_torus(2 * across, across)


def compared(mesh: Mesh, count: int) -> dict[str, Any]:
    """Return the seconds of both ways, and the largest relative errors of the approximate eigenvalues."""
    fast_seconds, fast = timed(fast_harmonics, mesh, count)
    exact_seconds, exact = timed(manifold_harmonics, mesh, count)
    errors = fast.values[1:] / exact.values[1:] - 1  # the first is 0
    return {
        "vertices": len(mesh.vertices),
        "exact": exact_seconds,
        "fast": fast_seconds,
        "ratio": exact_seconds / fast_seconds,
        "lower_half": float(errors[: count // 2].max()),
        "largest": float(errors.max()),
    }


def timed(function: Callable[[Mesh, int], Harmonics], mesh: Mesh, count: int) -> tuple[float, Harmonics]:
    """Return the processor seconds of a function on a fresh mesh, and its result."""
    fresh = Mesh(mesh.vertices, mesh.faces)
    start = time.process_time()
    found = function(fresh, count)
    return time.process_time() - start, found


def table(figures: results.Figures) -> str:
    """Return a row for each mesh."""
    rows = [
        [
            *(f"{one['vertices']:,}", f"{one['exact']:.0f}", f"{one['fast']:.1f}", f"{one['ratio']:.1f}"),
            *(f"{100 * one['lower_half']:.1f} %", f"{100 * one['largest']:.1f} %"),
        ]
        for one in figures["meshes"]
    ]
    return f"{figures['count']} eigenpairs; {figures['machine']}.\n\n{results.markdown(TITLES, rows)}"


if __name__ == "__main__":
    main()
