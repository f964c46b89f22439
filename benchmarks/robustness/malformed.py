"""Run this package and others on meshes with one thing wrong each.

    python -m benchmarks.robustness.malformed [--python FILE] [--record]

Each tool runs on each mesh in a process of its own, with a limit of processor time and of memory, on arrays in memory
and at its defaults. The table is that of benchmarks/dirty_input.md. Tools that the given Python does not have get no
column.
"""

import argparse
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks import results
from benchmarks.robustness.dirty_meshes import Dirty, dirty_meshes

LIMIT_S = 120  # of processor time for a mesh
MEMORY = 8 << 30  # bytes of address space for a mesh, code and libraries included
TIMEOUT_S = 60 * LIMIT_S  # of wall time for all meshes
LONGEST = 160  # characters of a message in the table
FAR = 10  # mean edge lengths that no sound method moves a vertex of these meshes

OURS = "cascadenorm"
TOOLS = {
    OURS: """
import cascadenorm

def denoise(vertices, faces):
    return cascadenorm.denoise(vertices, faces)
""",
    "trimesh": """
import trimesh

def denoise(vertices, faces):
    return trimesh.smoothing.filter_taubin(trimesh.Trimesh(vertices, faces, process=False)).vertices
""",
    "open3d": """
import open3d

def denoise(vertices, faces):
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices.astype(float)), open3d.utility.Vector3iVector(faces.astype(numpy.int32))
    )
    return mesh.filter_smooth_taubin(10).vertices
""",
    "pyvista": """
import pyvista

def denoise(vertices, faces):
    return pyvista.PolyData.from_regular_faces(vertices, faces).smooth_taubin().points
""",
}
"""Code of a function that turns vertices and faces into the new vertices, by the name of the tool."""

EACH_IN_A_PROCESS = """
import os, resource, sys, warnings
import numpy

warnings.simplefilter("ignore")

def attempt(name):
    resource.setrlimit(resource.RLIMIT_CPU, ({limit}, {limit} + 1))
    resource.setrlimit(resource.RLIMIT_AS, ({memory}, {memory}))
    given = numpy.load(name + ".npz")
    try:
        numpy.save(name + ".npy", numpy.asarray(denoise(given["vertices"], given["faces"])))
    except Exception as error:
        with open(name + ".error", "w") as file:
            file.write(type(error).__name__ + ": " + str(error))
    os._exit(0)

for name in sys.argv[1:]:
    child = os.fork() or attempt(name)
    with open(name + ".signal", "w") as file:
        file.write(str(os.WTERMSIG(os.waitpid(child, 0)[1])))
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure every tool that is installed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default=sys.executable, help="the Python in which the other tools are installed")
    results.add_option(parser, "malformed")
    options = parser.parse_args(arguments)
    pythons = {name: sys.executable if name == OURS else options.python for name in TOOLS}
    versions = {name: found for name, python in pythons.items() if (found := version(name, python))}
    columns = {f"{name} {found}": measured(name, pythons[name]) for name, found in versions.items()}
    inputs = {mesh: [column[mesh] for column in columns.values()] for mesh in dirty_meshes()}
    results.report(options.record, {"tools": list(columns), "inputs": inputs}, table)


def table(figures: results.Figures) -> str:
    """Return a row for each mesh."""
    rows = [[mesh, *outcomes] for mesh, outcomes in figures["inputs"].items()]
    return results.markdown(["input", *figures["tools"]], rows, numbers=False)


def version(name: str, python: str) -> str:
    """Return the version of a tool; empty if it cannot be imported."""
    code = f"import importlib.metadata, {name}; print(importlib.metadata.version({name!r}))"
    return subprocess.run([python, "-c", code], capture_output=True, text=True).stdout.strip()


def measured(name: str, python: str) -> dict[str, str]:
    """Return in words what a tool makes of each mesh."""
    meshes = dirty_meshes()
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / str(number) for number in range(len(meshes))]
        for file, dirty in zip(files, meshes.values(), strict=True):
            np.savez(f"{file}.npz", vertices=dirty.vertices, faces=dirty.faces)
        code = TOOLS[name] + EACH_IN_A_PROCESS.format(limit=LIMIT_S, memory=MEMORY)
        subprocess.run([python, "-c", code, *map(str, files)], stdout=subprocess.DEVNULL, timeout=TIMEOUT_S, check=True)
        outcomes = [outcome(file) for file in files]
    at_origin = outcomes[0]
    assert not isinstance(at_origin, str), f"{name} cannot do the sound mesh: {at_origin}"
    return {
        mesh: out if isinstance(out, str) else judged(dirty, out, at_origin)
        for (mesh, dirty), out in zip(meshes.items(), outcomes, strict=True)
    }


def outcome(file: Path) -> np.ndarray | str:
    """Return the vertices of a tool, or in words how it ended without any."""
    ended = int(Path(f"{file}.signal").read_text())
    if ended:
        return f"**no end within {LIMIT_S} s**" if ended == signal.SIGXCPU else f"**the process dies** (signal {ended})"
    refusal = Path(f"{file}.error")
    if refusal.exists():
        return "refused: " + " ".join(refusal.read_text().replace("|", "/").split())[:LONGEST]
    return np.load(f"{file}.npy")


def judged(dirty: Dirty, out: np.ndarray, at_origin: np.ndarray) -> str:
    """Return in words what came out: how many vertices are lost, not finite or far away, or that all is well."""
    before = dirty.vertices.astype(float)
    if out.shape != before.shape:
        return f"**{len(before)} vertices become {len(out)}**"
    was_finite = np.isfinite(before).all(axis=1)
    spoiled = was_finite & ~np.isfinite(out).all(axis=1)
    if spoiled.any():
        return f"**{spoiled.sum()} sound vertices are not finite any more**"
    with np.errstate(all="ignore"):
        moved = out.astype(float) - before
    edge = median_side(dirty)
    if dirty.alike:
        reference = dirty_meshes()["sound"].vertices
        step = moved[: len(reference)] / dirty.scale - (at_origin - reference)
        off = np.linalg.norm(step, axis=1).max() / (edge / dirty.scale)
        return "as the sound mesh" if off < 0.01 else f"**up to {off:.2g} edges off the result for the sound mesh**"
    ordinary = was_finite & (np.abs(before).max(axis=1, initial=0) < 1e3)
    farthest = np.linalg.norm(moved[ordinary], axis=1).max(initial=0) / edge
    return f"**vertices move by {farthest:.2g} edges**" if farthest > FAR else "done"


def median_side(dirty: Dirty) -> float:
    """Return the median side of the faces, each measured by its largest difference of coordinates."""
    good = ((dirty.faces >= 0) & (dirty.faces < len(dirty.vertices))).all(axis=1)
    corners = dirty.vertices[dirty.faces[good]].astype(float)
    with np.errstate(all="ignore"):
        sides = np.abs(corners - np.roll(corners, 1, axis=1)).max(axis=2)  # no squares, which overflow at 1e300
        return float(np.median(sides)) if sides.size else 1.0


if __name__ == "__main__":
    main()
