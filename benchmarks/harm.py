"""Measure what a method does to clean meshes, which should stay as they are.

    python benchmarks/harm.py DIR [--method NAME] [--strength NUMBER]

For each mesh file in DIR: the mean area-weighted angle between the normals before and after, the largest displacement
in per cent of the diagonal of the bounding box, flipped faces, and the change of the enclosed volume.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import cascadenorm as cn
from cascadenorm.interop import as_mesh
from cascadenorm.mesh import Mesh, angles_between


def main(arguments: Sequence[str] | None = None) -> None:
    """Denoise each mesh and print a line about it, then how many are within the limits that the docs state."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--method", default="auto")
    parser.add_argument("--strength", type=float, default=1.0)
    chosen = parser.parse_args(arguments)
    paths = sorted(path for path in chosen.folder.iterdir() if path.suffix.lower() in (".stl", ".ply", ".obj", ".off"))
    within = 0
    for path in paths:
        mesh = as_mesh(path)
        angle, moved, flipped, volume = harm(mesh, cn.denoise(mesh, method=chosen.method, strength=chosen.strength))
        within += angle <= 0.5 and moved <= 0.1 and flipped == 0 and abs(volume) <= 0.05
        print(f"{path.name:28s} {angle:6.3f}° {moved:7.4f} % {flipped:5d} flipped, volume {volume:+.4f} %", flush=True)
    print(f"{within} of {len(paths)} within 0.5°, 0.1 % of the diagonal, no flipped face, 0.05 % of the volume")


def harm(before: Mesh, after: Mesh) -> tuple[float, float, int, float]:
    """Mean angle in degrees, largest displacement in per cent of the diagonal, flipped faces, per cent of volume."""
    angles = np.degrees(angles_between(before.normals, after.normals))
    moved = np.linalg.norm(after.vertices - before.vertices, axis=1).max() / before.diagonal
    volumes = [float(np.einsum("ij,ij->", mesh.centroids, mesh.area_vectors)) / 3 for mesh in (before, after)]
    change = 100 * (volumes[1] / volumes[0] - 1) if volumes[0] else 0.0
    return float(before.areas @ angles / before.areas.sum()), 100 * float(moved), int((angles > 90).sum()), change


if __name__ == "__main__":
    main()
