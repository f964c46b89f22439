"""Measure methods on real kinds of error from weak to strong.

    python -m benchmarks.accuracy.levels [--shapes 8] [--text FILE]

Shapes are drawn from a seed that no training has. Each is meshed from grey volumes with more and more grain, from
points that are more and more off, and with more and more error that is alike in neighbouring vertices; each mesh is
denoised by each method. The table of mean angles to the true surface is printed, and replaces what stands between the
markers of --text.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

import cascadenorm as cn
from benchmarks.accuracy.extractors import METHODS, SHAPES, angle
from benchmarks.accuracy.results import between_markers
from cascadenorm.data_gen.families import FAMILIES, Family
from cascadenorm.data_gen.meshing.surface import UnfitShapeError, extent_of
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.scanning.measured import Measured
from cascadenorm.data_gen.scanning.points import reconstruction
from cascadenorm.data_gen.scanning.volumes import tomogram
from cascadenorm.execution.process_map import side_by_side
from cascadenorm.mesh import thread_count

BEGIN, END = "<!-- levels: written by benchmarks/accuracy/levels.py -->", "<!-- end of levels -->"
SEED = 992
FACES = 10_000

Maker = Callable[[Family, float, np.random.Generator], Measured]


def grainy(family: Family, share: float, rng: np.random.Generator) -> Measured:
    """Mesh a grey volume whose grain deviates by a share of the contrast."""
    field = family.shape(0.05, rng)
    return tomogram(field, extent_of(field, rng=rng), faces=FACES, level=5 * share, rng=rng)


def reconstructed(family: Family, gaps: float, rng: np.random.Generator) -> Measured:
    """Reconstruct from points that are off along the normals, by so many mean distances between points."""
    field = family.shape(0.05, rng)
    return reconstruction(field, extent_of(field, rng=rng), faces=FACES, level=gaps, rng=rng)


def bumpy(family: Family, edges: float, rng: np.random.Generator) -> Measured:
    """Displace the vertices of a clean mesh by error that is correlated over several edges."""
    clean = family.make(faces=FACES, rng=rng).clean
    noisy = clean.moved(clean.vertices + displacements(clean, "correlated", level=edges, rng=rng))
    return Measured.on_surface(noisy, clean)


ERRORS: list[tuple[str, Maker, float]] = [
    *((f"tomogram, grain of {share:.0%} of the contrast", grainy, share) for share in (0.02, 0.05, 0.1, 0.15)),
    *((f"points off by {gaps:g} of their distance", reconstructed, gaps) for gaps in (0.25, 0.5, 1.0, 2.0)),
    *((f"correlated error of {edges:g} edges", bumpy, edges) for edges in (0.1, 0.2, 0.4, 0.8)),
]


def main(arguments: Sequence[str] | None = None) -> None:
    """Make, denoise and measure, and print the means as a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shapes", type=int, default=8)
    parser.add_argument("--text", type=Path)
    chosen = parser.parse_args(arguments)
    lines = [f"| mean angle, degrees | mesh | {' | '.join(METHODS)} |", "| --- |" + " ---: |" * (1 + len(METHODS))]
    with side_by_side(thread_count()) as each:
        for name, make, level in ERRORS:
            figures = list(each(partial(angles_of_shape, make=make, level=level), range(chosen.shapes)))
            lines.append(f"| {name} | " + " | ".join(f"{mean:.1f}" for mean in np.mean(figures, axis=0)) + " |")
            print(lines[-1], flush=True)
    if chosen.text:
        text = chosen.text.read_text(encoding="utf-8")
        chosen.text.write_text(between_markers(text, "\n".join(lines), BEGIN, END), encoding="utf-8")


def angles_of_shape(number: int, *, make: Maker, level: float) -> list[float]:
    """Make a mesh of a shape: its angle, and that of what each method makes of it."""
    rng = np.random.default_rng([SEED, number])
    while True:
        try:
            noisy, _, normals = make(FAMILIES[SHAPES[number % len(SHAPES)]], level, rng)
        except UnfitShapeError:
            continue
        break
    return [angle(mesh, normals) for mesh in (noisy, *(cn.denoise(noisy, method=name) for name in METHODS))]


if __name__ == "__main__":
    main()
