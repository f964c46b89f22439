"""Measure what a method does to clean meshes, which should stay as they are.

    python -m benchmarks.accuracy.harm [DIR] [--parts COUNT] [--seed SEED] [--method NAME] [--model FILE]
        [--strength NUMBER]

For each mesh file in DIR, or each of so many generated parts as CAD kernels tessellate them: the mean area-weighted
angle between the normals before and after, the largest displacement in per cent of the diagonal of the bounding box,
flipped faces, and the change of the enclosed volume.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import cascadenorm as cn
from cascadenorm.data_gen.meshing.cad_tessellation import cad_part
from cascadenorm.data_gen.meshing.surface import UnfitShapeError
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import Mesh, angles_between


def main(arguments: Sequence[str] | None = None) -> None:
    """Denoise each mesh and print a line about it, then how many are within the limits that the docs state."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR", nargs="?")
    parser.add_argument("--parts", type=int, default=0, metavar="COUNT")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--method", default="auto")
    parser.add_argument("--model", type=Path, help="weights, for auto and cascade")
    parser.add_argument("--strength", type=float, default=1.0)
    chosen = parser.parse_args(arguments)
    parameters = {"model": chosen.model} if chosen.model else {}
    within = count = 0
    for name, mesh in meshes(chosen.folder, chosen.parts, seed=chosen.seed):
        after = cn.denoise(mesh, method=chosen.method, strength=chosen.strength, **parameters)
        angle, moved, flipped, volume = harm(mesh, after)
        count += 1
        within += angle <= 0.5 and moved <= 0.1 and flipped == 0 and abs(volume) <= 0.05
        print(f"{name:28s} {angle:6.3f}° {moved:7.4f} % {flipped:5d} flipped, volume {volume:+.4f} %", flush=True)
    print(f"{within} of {count} within 0.5°, 0.1 % of the diagonal, no flipped face, 0.05 % of the volume")


def meshes(folder: Path | None, parts: int, *, seed: int) -> Iterator[tuple[str, Mesh]]:
    """Read the files of a folder, then generate parts; those that come out unfit are drawn again."""
    for path in sorted(folder.iterdir()) if folder else []:
        if path.suffix.lower() in (".stl", ".ply", ".obj", ".off"):
            yield path.name, as_mesh(path)
    for index in range(parts):
        rng = np.random.default_rng([seed, index])
        while True:
            try:
                yield f"part {index}", cad_part(faces=None, rng=rng)
            except UnfitShapeError:
                continue
            break


def harm(before: Mesh, after: Mesh) -> tuple[float, float, int, float]:
    """Mean angle in degrees, largest displacement in per cent of the diagonal, flipped faces, per cent of volume."""
    angles = np.degrees(angles_between(before.face_normals, after.face_normals))
    moved = np.linalg.norm(after.vertices - before.vertices, axis=1).max() / before.diagonal
    volumes = [float(np.einsum("ij,ij->", mesh.centroids, mesh.area_vectors)) / 3 for mesh in (before, after)]
    change = 100 * (volumes[1] / volumes[0] - 1) if volumes[0] else 0.0
    return float(before.areas @ angles / before.areas.sum()), 100 * float(moved), int((angles > 90).sum()), change


if __name__ == "__main__":
    main()
