"""What every method makes of two meshes, in a few numbers: `python tests/helpers/golden.py` writes golden.json anew."""

import json
from pathlib import Path

import numpy as np
from shapes import cube, icosphere, noisy

from cascadenorm import denoise
from cascadenorm.mesh import Mesh
from cascadenorm.registry import find, registered

RECORD = Path(__file__).with_name("golden.json")
MESHES = {"cube, 1,200 faces": (cube, 10), "sphere, 20,480 faces": (icosphere, 5)}
PROJECTIONS = 4


def made(size: str) -> Mesh:
    """Return one of the meshes, with noise."""
    shape, steps = MESHES[size]
    return noisy(shape(steps), 0.2)


def digest(method: str, mesh: Mesh) -> list[float]:
    """Project the displacements of all vertices, in mean edge lengths, on a few random directions of unit length."""
    part = {"mask": mesh.vertices[:, 0] > 0} if "region" in find(method).settings else {}
    moved = denoise(mesh, method=method, **part).vertices - mesh.vertices
    directions = np.random.default_rng(1).normal(size=(PROJECTIONS, moved.size))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return [round(float(number), 10) for number in directions @ moved.ravel() / mesh.mean_edge_length]


if __name__ == "__main__":
    found = {size: {name: digest(name, made(size)) for name in registered()} for size in MESHES}
    RECORD.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
