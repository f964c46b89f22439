"""Measure methods on meshes of real kinds of error.

    python -m benchmarks.accuracy.real DIR --truth PATTERN [--method NAME ...]

DIR holds a folder KIND-SHAPE with noisy.* for each case; PATTERN is the path of the true mesh of a case, in which
{shape} stands for SHAPE. Faces need not be those of the truth. The table of the kinds is printed, and replaces what
stands between the markers of --text.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import cascadenorm as cn
from benchmarks.accuracy.results import between_markers
from cascadenorm.geometry.nearest import Surface
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import Mesh, angles_between

BEGIN, END = "<!-- real errors: written by benchmarks/accuracy/real.py -->", "<!-- end of real errors -->"


def main(arguments: Sequence[str] | None = None) -> None:
    """Denoise each case by each method, print its figures, and the means of each kind as a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--truth", required=True, metavar="PATTERN", help="such as models/{shape}.ply")
    parser.add_argument("--method", action="append", help="may be given several times")
    parser.add_argument("--model", type=Path, help="weights, for auto and cascade")
    parser.add_argument("--results", type=Path, help="folder of denoised cases, KIND-SHAPE.*, in place of methods")
    parser.add_argument("--text", type=Path)
    chosen = parser.parse_args(arguments)
    methods = chosen.method or ["auto"]
    cases = sorted(path.parent for path in chosen.folder.glob("*-*/noisy.*"))
    figures: dict[str, list[list[tuple[float, float]]]] = {}
    surfaces: dict[str, tuple[Mesh, Surface]] = {}
    for case in cases:
        kind, shape = case.name.split("-", 1)
        if shape not in surfaces:
            truth = as_mesh(Path(chosen.truth.format(shape=shape)))
            surfaces[shape] = truth, Surface(truth)
        noisy = as_mesh(next(case.glob("noisy.*")))
        meshes = [noisy]
        if chosen.results:
            meshes.append(as_mesh(next(chosen.results.glob(case.name + ".*"))))
        else:
            meshes += [cn.denoise(noisy, method=name, **_model(name, chosen.model)) for name in methods]
        row = [errors(mesh, *surfaces[shape], edge=noisy.mean_edge_length) for mesh in meshes]
        figures.setdefault(kind, []).append(row)
        print(f"{case.name:24s}", "  ".join(f"{angle:6.2f} ({rms:.3f})" for angle, rms in row), flush=True)
    names = ["noisy", chosen.results.name] if chosen.results else ["noisy", *methods]
    lines = [f"| mean angle, degrees (RMS, edges) | {' | '.join(names)} |", "| --- |" + " ---: |" * len(names)]
    for kind, rows in figures.items():
        means = np.mean(rows, axis=0)
        lines.append(
            f"| {kind} ({len(rows)}) | " + " | ".join(f"{angle:.1f} ({rms:.3f})" for angle, rms in means) + " |"
        )
    table = "\n".join(lines)
    print(table)
    if chosen.text:
        text = chosen.text.read_text(encoding="utf-8")
        chosen.text.write_text(between_markers(text, table, BEGIN, END), encoding="utf-8")


def errors(mesh: Mesh, truth: Mesh, surface: Surface, *, edge: float) -> tuple[float, float]:
    """Mean angle, by area, to the true faces nearest to the centroids, degrees; RMS distance of vertices, in edges."""
    theirs = truth.face_normals[surface.nearest(mesh.centroids).faces]
    known = mesh.face_normals.any(axis=1) & theirs.any(axis=1)
    angle = np.degrees(np.average(angles_between(mesh.face_normals[known], theirs[known]), weights=mesh.areas[known]))
    distances = surface.nearest(mesh.vertices[mesh.topology.used_vertices]).distances
    return float(angle), float(np.sqrt(np.mean(distances**2)) / edge)


def _model(method: str, model: Path | None) -> dict[str, Path]:
    return {"model": model} if model and method in ("auto", "cascade") else {}


if __name__ == "__main__":
    main()
