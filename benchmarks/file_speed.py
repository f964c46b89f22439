"""Processor time of reading, writing and Taubin smoothing, beside other libraries.

    python benchmarks/file_speed.py [--peers PYTHON ...]

PYTHON is the interpreter of an environment with other libraries: trimesh, meshio, pyvista, open3d, pymeshlab. The first
one that has a library measures it; the last one is that which runs this. The table is printed, and written to
benchmarks/file_speed.md. Each figure is the least of several runs.
"""

import argparse
import json
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from speed import wavy_torus

from cascadenorm.interop import save_mesh

FORMATS = ("ply", "obj", "stl", "glb")
STEPS = 400, 250
"""Of the torus: 200,000 faces."""
LIBRARIES = ("cascadenorm", "trimesh", "meshio", "pyvista", "open3d", "pymeshlab")
MEASURE = """
import json, sys, time, warnings
warnings.simplefilter("ignore")
library, folder, formats = sys.argv[1], sys.argv[2], sys.argv[3:]
RUNS, STEPS = 3, 10

def cascadenorm():
    import cascadenorm as cn
    from cascadenorm.io import from_arrays
    return (lambda path: cn.read(path).mesh,
            lambda mesh, path: cn.write(from_arrays(mesh.vertices, mesh.faces), path, force=True),
            lambda mesh: cn.denoise(mesh, method="taubin", iterations=STEPS))

def trimesh():
    import trimesh
    return (lambda path: trimesh.load_mesh(path, process=False),
            lambda mesh, path: mesh.export(path),
            lambda mesh: trimesh.smoothing.filter_taubin(mesh.copy(), iterations=2 * STEPS))

def meshio():
    import meshio
    return meshio.read, lambda mesh, path: mesh.write(path), None

def pyvista():
    import pyvista
    return (pyvista.read, lambda mesh, path: mesh.save(path),
            lambda mesh: mesh.smooth_taubin(n_iter=2 * STEPS))

def open3d():
    from open3d.io import read_triangle_mesh, write_triangle_mesh
    def write(mesh, path):
        if not write_triangle_mesh(path, mesh):  # as STL without normals
            raise ValueError("nothing was written")
    return (read_triangle_mesh, write,
            lambda mesh: mesh.filter_smooth_taubin(STEPS))

def pymeshlab():
    import pymeshlab
    def read(path):
        meshes = pymeshlab.MeshSet()
        meshes.load_new_mesh(path)
        return meshes
    return (read, lambda meshes, path: meshes.save_current_mesh(path),
            lambda meshes: meshes.apply_coord_taubin_smoothing(stepsmoothnum=STEPS))

def least(work):
    times = []
    for _ in range(RUNS):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)

try:
    read, write, smooth = globals()[library]()
except ImportError:
    sys.exit(3)
found = {}
for format in formats:
    source, target = f"{folder}/mesh.{format}", f"{folder}/{library}.{format}"
    try:
        mesh = read(source)
        found[f"read {format}"] = least(lambda: read(source))
        found[f"write {format}"] = least(lambda: write(mesh, target))
        if format == "ply" and smooth:
            found["taubin"] = least(lambda: smooth(mesh))
    except Exception as error:
        print(library, format, repr(error)[:200], file=sys.stderr)
print(json.dumps(found))
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure each library in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", nargs="*", default=[], metavar="PYTHON", help="interpreters with other libraries")
    parser.add_argument("--output", type=Path, default=Path(__file__).with_suffix(".md"))
    chosen = parser.parse_args(arguments)
    found: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        mesh = wavy_torus(*STEPS)
        for format in FORMATS:
            save_mesh(Path(folder) / f"mesh.{format}", mesh)
        for library in LIBRARIES:
            for python in [sys.executable] if library == LIBRARIES[0] else [*chosen.peers, sys.executable]:
                command = [python, "-c", MEASURE, library, folder, *FORMATS]
                done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
                if done.returncode == 0:
                    found[library] = json.loads(done.stdout.splitlines()[-1])
                    break
    rows = [f"{verb} {format}" for format in FORMATS for verb in ("read", "write")] + ["taubin"]
    text = "\n".join(
        [
            "# Files and Taubin smoothing beside other libraries",
            "",
            f"Processor time in milliseconds, {len(mesh.faces):,} faces, 10 pairs of steps of Taubin smoothing; "
            f"{platform.system()} {platform.machine()}, Python {platform.python_version()}. "
            "`python benchmarks/file_speed.py` writes this page. Here reading includes all checks, and the merging "
            "of equal corners of STL and glTF; numbers are written with all digits.",
            "",
            f"| | {' | '.join(found)} |",
            f"| --- |{' ---: |' * len(found)}",
            *(f"| {row} | {' | '.join(shown(of.get(row)) for of in found.values())} |" for row in rows),
            "",
        ]
    )
    chosen.output.write_text(text, encoding="utf-8")
    print(text, end="")


def shown(seconds: float | None) -> str:
    """Write milliseconds, or nothing."""
    return "" if seconds is None else f"{1000 * seconds:.0f}"


if __name__ == "__main__":
    main()
