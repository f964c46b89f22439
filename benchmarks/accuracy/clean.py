"""Measure how much methods change clean meshes, which should stay the same, and nearly clean ones.

    python -m benchmarks.accuracy.clean FOLDER [--method NAME ...] [--record NAME]
    python -m benchmarks.accuracy.clean --parts 100
    python -m benchmarks.accuracy.clean PAIRS --noise 0 0.01 0.03 [--record low-noise]

FOLDER holds mesh files, or pairs, whose clean meshes are measured, each once. `--parts` generates parts as CAD kernels
tessellate them. Of each mesh: the mean change of the face normals by area, the RMS displacement in mean edge lengths,
the largest one in per cent of the diagonal of the bounding box, flipped faces, faces that intersect others after
denoising but did not before, and the change of the enclosed volume.

With `--noise`, each mesh gets Gaussian noise along its normals, in mean edge lengths, and the table has the mean angle
to the clean mesh. The record `low-noise` is shown in benchmarks/accuracy.md.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import results, running
from cascadenorm.api.inspection.crossings import crossing_faces
from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.cad_tessellation import cad_part
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.geometry.metrics import measure
from cascadenorm.io import is_mesh_name
from cascadenorm.io.interop import as_mesh
from cascadenorm.io.pairs import find_pairs
from cascadenorm.mesh import Mesh, angles_between, in_frame

NOISY = "noisy"
METHODS = ("auto",)
METHODS_WITH_NOISE = ("auto", "cascade", "bilateral-normal")
TITLES = (
    *("mesh", "method", "faces", "angle, degrees", "RMS, edges", "largest, % of the diagonal", "flipped"),
    *("new intersections", "volume, %"),
)


class Change(NamedTuple):
    """How a method changed a clean mesh.

    Parameters
    ----------
    angle
        Mean change of the face normals by area, in degrees.
    rms
        Root mean square of the displacement, in mean edge lengths.
    largest
        Largest displacement, in per cent of the diagonal of the bounding box.
    flipped
        Number of faces whose normals changed by more than 90 degrees.
    crossing
        Number of faces that intersect others and did not before.
    volume
        Change of the enclosed volume in per cent; 0 for a mesh without volume.
    """

    angle: float
    rms: float
    largest: float
    flipped: float
    crossing: float
    volume: float

    @property
    def is_small(self) -> bool:
        """Whether the change is within the limits that the documentation states."""
        return self.angle <= 0.5 and self.largest <= 0.1 and self.flipped == 0 and abs(self.volume) <= 0.05


def main(arguments: Sequence[str] | None = None) -> None:
    """Denoise each mesh by each method, and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER", nargs="?", help="mesh files, or pairs")
    parser.add_argument("--parts", type=int, default=0, metavar="COUNT", help="CAD parts to generate")
    parser.add_argument("--seed", type=int, default=0, help="of the parts")
    parser.add_argument("--noise", type=float, nargs="+", metavar="LEVEL", help="in mean edge lengths")
    running.add_methods(parser, METHODS)
    results.add_option(parser)
    options = parser.parse_args(arguments)
    if not (options.folder or options.parts):
        parser.error("give FOLDER or --parts")
    meshes = clean_meshes(options.folder, options.parts, seed=options.seed)
    if options.noise:
        found = low_noise(meshes, options.method or METHODS_WITH_NOISE, options.noise)
        results.report(options.record, found, low_noise_table)
    else:
        results.report(options.record, changes(meshes, running.chosen_methods(options)), table)


def clean_meshes(folder: Path | None, parts: int = 0, *, seed: int = 0) -> Iterator[tuple[str, Mesh]]:
    """Read the meshes of a folder, then generate parts. Unsuitable parts are replaced."""
    if folder:
        files = [path for path in sorted(folder.iterdir()) if path.is_file() and is_mesh_name(path)]
        named = [(path.name, path) for path in files] or [(pair.name, pair.clean) for pair in find_pairs([folder])]
        contents = {path.read_bytes(): (name, path) for name, path in reversed(named)}
        yield from ((name, as_mesh(path)) for name, path in reversed(contents.values()))
    for index in range(parts):
        rng = np.random.default_rng([seed, index])
        while True:
            try:
                yield f"part {index}", cad_part(faces=None, rng=rng)
            except UnfitShapeError:
                continue
            break


def changes(meshes: Iterator[tuple[str, Mesh]], methods: Sequence[str]) -> dict[str, Any]:
    """Return how each method changes each mesh."""
    found: dict[str, Any] = {}
    for name, mesh in meshes:
        of_mesh = {method: change(mesh, running.denoised(mesh, method)) for method in methods}
        found[name] = {"faces": len(mesh.faces), "changes": {key: value._asdict() for key, value in of_mesh.items()}}
        for method, one in of_mesh.items():
            print(f"{name}, {method}: {one.angle:.2f}°, {one.flipped} flipped, {one.crossing} crossing", flush=True)
    return {"methods": list(methods), "meshes": found}


def change(before: Mesh, after: Mesh) -> Change:
    """Compare a mesh before and after denoising."""
    sized = before.face_normals.any(axis=1) & after.face_normals.any(axis=1)
    angles = np.degrees(angles_between(before.face_normals[sized], after.face_normals[sized]))
    moved = np.linalg.norm(after.vertices - before.vertices, axis=1)
    volumes = [float(np.einsum("ij,ij->", mesh.centroids, mesh.area_vectors)) / 3 for mesh in (before, after)]
    return Change(
        angle=float(np.average(angles, weights=before.areas[sized])),
        rms=float(np.sqrt(np.mean(moved**2)) / before.mean_edge_length),
        largest=float(100 * moved.max() / before.diagonal),
        flipped=int((angles > 90).sum()),
        crossing=int((_crossing(after) & ~_crossing(before)).sum()),
        volume=100 * (volumes[1] / volumes[0] - 1) if volumes[0] else 0.0,
    )


def _crossing(mesh: Mesh) -> np.ndarray:
    return crossing_faces(in_frame(mesh)[0])


def table(figures: results.Figures) -> str:
    """Return a row for each mesh and method, the means of each method, and how many meshes hardly changed."""
    meshes: Mapping[str, Any] = figures["meshes"]
    rows = [
        _row(name, method, f"{mesh['faces']:,}", Change(**mesh["changes"][method]))
        for name, mesh in meshes.items()
        for method in figures["methods"]
    ]
    lines = []
    for method in figures["methods"]:
        every = [Change(**mesh["changes"][method]) for mesh in meshes.values()]
        mean = Change(*(sum(values) / len(every) for values in zip(*every, strict=True)))
        rows.append(_row("**mean**", method, "", mean))
        lines.append(
            f"`{method}`: {sum(one.is_small for one in every)} of {len(every)} within 0.5°, 0.1 % of the diagonal, no "
            "flipped face and 0.05 % of the volume."
        )
    return "\n\n".join([results.markdown(TITLES, rows), *lines])


def _row(name: str, method: str, faces: str, one: Change) -> list[str]:
    return [
        *(name, method, faces, f"{one.angle:.2f}", f"{one.rms:.3f}", f"{one.largest:.3f}"),
        *(f"{one.flipped:.4g}", f"{one.crossing:.4g}", f"{one.volume:+.4f}"),
    ]


def low_noise(meshes: Iterator[tuple[str, Mesh]], methods: Sequence[str], levels: Sequence[float]) -> dict[str, Any]:
    """Return the mean angle to the clean mesh at each level of noise: over all meshes, and the worst of them."""
    clean = [mesh for _, mesh in meshes]
    found = {}
    for level in levels:
        angles: dict[str, list[float]] = {method: [] for method in (NOISY, *methods)}
        for mesh in clean:
            noise = displacements(mesh, "normal", level=level, rng=np.random.default_rng(0))
            noisy = mesh.moved(mesh.vertices + noise)
            angles[NOISY].append(measure(noisy, mesh).normal_error_deg)
            for method in methods:
                angles[method].append(measure(running.denoised(noisy, method), mesh).normal_error_deg)
        found[f"{level:g}"] = {method: [float(np.mean(every)), max(every)] for method, every in angles.items()}
        print(level, found[f"{level:g}"], flush=True)
    return {"columns": [NOISY, *methods], "levels": found}


def low_noise_table(figures: results.Figures) -> str:
    """Return a row for each level of noise: the mean angle, and that of the worst mesh in brackets."""
    columns = figures["columns"]
    rows = [
        [level, *("{:.2f} ({:.2f})".format(*found[name]) for name in columns)]
        for level, found in figures["levels"].items()
    ]
    return results.markdown(["noise", *columns], rows)


if __name__ == "__main__":
    main()
