"""Compare the classical methods with the authors' programs, at the same parameters.

    python -m benchmarks.accuracy.reference PAIRS RESULTS.json [METHOD …]

PAIRS holds a folder with noisy.* and clean.* for each pair. RESULTS.json is pair → run → {"params", "Ea_deg"}: a run is
"bnf", "gnf", "l0", "fleishman" or "jones" and the name of a setting; the parameters have the names of the program that
comes with Zhang et al. 2015. Prints a Markdown table of mean normal errors in degrees:

- theirs: the error of that program
- ours: our method, with its own vertex update and treatment of boundaries
- same update: our filter of normals with their vertex update, if that differs
"""

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cascadenorm import methods
from cascadenorm.baselines.bilateral_normal import bilateral_normals, joint_bilateral_pass, spatial_weights
from cascadenorm.baselines.guided_normal import centroid_distance, faces_within, patch_guidance
from cascadenorm.baselines.l0 import mean_dihedral
from cascadenorm.geometry.metrics import measure
from cascadenorm.io.interop import as_mesh
from cascadenorm.io.pairs import find_pairs
from cascadenorm.mesh import Mesh, Vectors

Parameters = Mapping[str, Any]


class Program(NamedTuple):
    """One of the authors' methods: our name, its parameters in our units, and our filter with its vertex update."""

    method: str
    ours: Callable[[Mesh, Parameters], dict[str, Any]]
    same_update: Callable[[Mesh, Parameters], Vectors] | None = None


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pairs", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("methods", nargs="*", default=[program.method for program in PROGRAMS.values()])
    options = parser.parse_args(arguments)
    results = json.loads(options.results.read_text(encoding="utf-8"))
    print("| pair | run | theirs | ours | difference | same update |\n|---|---|---|---|---|---|")
    for pair in find_pairs([options.pairs]):
        noisy, clean = as_mesh(pair.noisy), as_mesh(pair.clean)
        for run, result in results.get(pair.name, {}).items():
            program = PROGRAMS.get(run.split()[0])
            if program is None or program.method not in options.methods or "params" not in result:
                continue
            theirs, parameters = result["Ea_deg"], result["params"]
            ours = _error(noisy, methods()[program.method](noisy, **program.ours(noisy, parameters)), clean)
            same = "–"
            if program.same_update is not None:
                same = f"{_error(noisy, program.same_update(noisy, parameters), clean):.2f}"
            print(f"| {pair.name} | {run} | {theirs:.2f} | {ours:.2f} | {ours - theirs:+.2f} | {same} |")
            sys.stdout.flush()


def _bilateral_normal(mesh: Mesh, parameters: Parameters) -> dict[str, Any]:
    return {
        "sigma_s": parameters["Multiple(* sigma_c)"] * centroid_distance(mesh),
        "sigma_r": parameters["sigma_s"],
        "iterations": parameters["Normal Iteration Num."],
        "sweeps": parameters["Vertex Iteration Num."],
    }


def _bilateral_normal_same_update(mesh: Mesh, parameters: Parameters) -> Vectors:
    settings = _bilateral_normal(mesh, parameters)
    sweeps = settings.pop("sweeps")
    return simultaneous_update(mesh, bilateral_normals(mesh, **settings), sweeps, fix_boundary=True)


def _guided_normal(mesh: Mesh, parameters: Parameters) -> dict[str, Any]:
    return {
        "radius": parameters["Multiple(* avg face dis.)"] * centroid_distance(mesh),
        # their σ_s is one mean distance of centroids, of the mesh as it is at each pass: our default
        "sigma_r": parameters["sigma_r"],
        "iterations": parameters["(Local)Normal Iteration Num."],
        "sweeps": parameters["Vertex Iteration Num."],
    }


def _guided_normal_same_update(mesh: Mesh, parameters: Parameters) -> Vectors:
    settings = _guided_normal(mesh, parameters)
    near = faces_within(mesh, settings["radius"])
    for _ in range(settings["iterations"]):
        weights = spatial_weights(mesh, near, parameters["Multiple(* sigma_s)"] * centroid_distance(mesh))
        guide = patch_guidance(mesh)
        normals = joint_bilateral_pass(mesh.face_normals, guide, mesh.areas, near, weights, settings["sigma_r"])
        mesh = mesh.moved(simultaneous_update(mesh, normals, settings["sweeps"]))
    return mesh.vertices


def _l0(mesh: Mesh, parameters: Parameters) -> dict[str, Any]:
    dihedral = mean_dihedral(mesh)
    return {
        "sparsity": parameters["lambda"] / (mesh.mean_edge_length**2 * dihedral),
        "regularity": parameters["alpha"] / dihedral,
        "growth": parameters["mu_beta"],
    }


def _bilateral(mesh: Mesh, parameters: Parameters) -> dict[str, Any]:
    return {"iterations": parameters["Iteration Num."]}


def _non_iterative_bilateral(mesh: Mesh, parameters: Parameters) -> dict[str, Any]:
    return {"sigma_f": parameters["sigma_f/mean_edge_length"], "sigma_g": parameters["sigma_g/mean_edge_length"]}


PROGRAMS = {
    "bnf": Program("bilateral-normal", _bilateral_normal, _bilateral_normal_same_update),
    "gnf": Program("guided-normal", _guided_normal, _guided_normal_same_update),
    "l0": Program("l0", _l0),
    "fleishman": Program("bilateral", _bilateral),
    "jones": Program("non-iterative-bilateral", _non_iterative_bilateral),
}


def simultaneous_update(mesh: Mesh, normals: Vectors, sweeps: int, *, fix_boundary: bool = False) -> Vectors:
    """Fit vertices to normals as those programs do: simultaneously, ignoring folds; the boundary can be fixed."""
    vertices = mesh.vertices.copy()
    count = np.maximum(mesh.topology.vertex_faces.counts, 1)[:, None]
    free = ~(mesh.topology.boundary_vertices & fix_boundary)
    for _ in range(sweeps):
        corners = vertices[mesh.faces]
        reach = np.einsum("md,mkd->mk", normals, corners.mean(axis=1, keepdims=True) - corners)
        pull = reach[:, :, None] * normals[:, None]
        total = np.stack(
            [np.bincount(mesh.faces.ravel(), pull[..., d].ravel(), len(vertices)) for d in range(3)], axis=1
        )
        vertices[free] += (total / count)[free]
    return vertices


def _error(noisy: Mesh, vertices: Vectors, clean: Mesh) -> float:
    return measure(noisy.moved(vertices), clean).normal_error_deg


if __name__ == "__main__":
    main()
