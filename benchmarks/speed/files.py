"""Compare reading, writing and Taubin smoothing with other libraries, and measure the memory of reading.

    python -m benchmarks.speed.files times [--environment DIR] [--turns 5] [--only KIND ...] [--record]
    python -m benchmarks.speed.files memory [--record]

`times` installs the other libraries into an environment of their own. All libraries take turns at each file, so that
whatever else the machine does slows all alike. Each figure is the least processor time of several turns. The table is
that of benchmarks/speed.md.

`memory` reads each file in a process of its own, in which kernels and libraries are loaded already, and measures what
reading adds at its peak. The table is that of docs/files.md.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import results
from benchmarks.environments import interpreter
from benchmarks.speed.meshes import MILLION, wavy_torus
from benchmarks.speed.peer_files import LIBRARIES, MISSING
from cascadenorm.io import read, write
from cascadenorm.io.content import Content
from cascadenorm.io.interop import save_mesh
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons

PACKAGES = ("trimesh", "scipy", "meshio", "pyvista", "open3d", "pymeshlab")
OURS, *PEERS = LIBRARIES
VERBS = {"read": "read {}", "write": "write {}", "replace": "write {}, moved", "smooth": "Taubin smoothing"}
ANEW = ("PLY", "STL", "OBJ", "GLB")
"""Kinds of file to which a mesh from arrays is written."""
PAIRS = 10
"""Number of pairs of steps of Taubin smoothing."""
FORMATS = {
    "PLY, binary": "ply",
    "GLB": "glb",
    "OFF": "off",
    "OBJ": "obj",
    "PLY, text": "text.ply",
    "STL, binary": "stl",
}
"""Formats of which the memory is measured."""
READ = """
import sys
from pathlib import Path
import cascadenorm as cn

def held(name):
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name)) * 1024

cn.read(sys.argv[1]).mesh  # a small file of the format: libraries and kernels are there from now on
before = held("VmRSS")
Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # proc(5): resets the peak
file = cn.read(sys.argv[2])
mesh = file.mesh
print(before, held("VmHWM") - before)
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure times or memory."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    times = commands.add_parser("times", help="beside other libraries")
    times.add_argument("--environment", type=Path, default=Path("build/peers"), help="of the other libraries")
    times.add_argument("--turns", type=int, default=5)
    times.add_argument(
        "--only", action="append", metavar="KIND", help="kind of file, such as 'OBJ'; may be given several times"
    )
    results.add_option(times, "files")
    results.add_option(commands.add_parser("memory", help="of reading"), "file-memory")
    options = parser.parse_args(arguments)
    if options.command == "memory":
        results.report(options.record, memory(), memory_table)
    else:
        found = times_of(interpreter(options.environment, PACKAGES), options.turns, options.only)
        results.report(options.record, found, table)


def times_of(python: Path, turns: int, only: Sequence[str] | None) -> dict[str, Any]:
    """Return the processor seconds of each library at each task."""
    mesh = wavy_torus(*MILLION)
    rows: dict[str, list[float | None]] = {}
    with tempfile.TemporaryDirectory() as folder:
        sources = files(mesh, Path(folder))
        libraries = [Library(name, sys.executable if name == OURS else python, Path(folder)) for name in LIBRARIES]
        for title, source in sources.items():
            if only and title not in only:
                continue
            verbs = ["read", *(["write"] if title in ANEW else []), "replace", *(["smooth"] if title == "PLY" else [])]
            for verb, seconds in measured(libraries, verbs, source, turns).items():
                rows[VERBS[verb].format(title)] = seconds
                print(verb, title, *map(_milliseconds, seconds), flush=True)
        for library in libraries:
            library.close()
    return {"machine": results.machine(), "faces": len(mesh.faces), "libraries": list(LIBRARIES), "times": rows}


def files(mesh: Mesh, folder: Path) -> dict[str, Path]:
    """Write a mesh as each kind of file, in single precision as most files are, and return their paths by title."""
    single = Mesh(mesh.vertices.astype(np.float32), mesh.faces)
    points, polygons = single.vertices.astype(np.float32), Polygons.from_rows(mesh.faces.astype(np.int64))
    normals, texture = single.vertex_normals.astype(np.float32), np.abs(points[:, :2]) % 1
    values = dict(zip(("nx", "ny", "nz", "s", "t"), np.column_stack([normals, texture]).T, strict=True))
    values |= {name: np.full(len(points), 128, np.uint8) for name in ("red", "green", "blue")}
    paths = {
        "PLY": folder / "mesh.ply",
        "PLY with normals, colours, texture coordinates": folder / "attributes.ply",
        "STL": folder / "mesh.stl",
        "STL as text": folder / "text.stl",
        "OBJ": folder / "mesh.obj",
        "OBJ with 16 digits": folder / "digits.obj",
        "OBJ with vt and vn": folder / "attributes.obj",
        "GLB": folder / "mesh.glb",
    }
    plain, with_values, stl, stl_text, obj, digits, obj_values, glb = paths.values()
    plain.write_bytes(b"".join(PlyFile.encode(Content(points, polygons))[0]))
    with_values.write_bytes(b"".join(PlyFile.encode(Content(points, polygons, values))[0]))
    write(read(plain), stl)
    stl_text.write_text("".join(stl_lines(single)), encoding="ascii")
    obj.write_text("".join(obj_lines(mesh.faces, v=points)), encoding="ascii")
    save_mesh(digits, mesh)
    obj_values.write_text("".join(obj_lines(mesh.faces, v=points, vt=texture, vn=normals)), encoding="ascii")
    write(read(plain), glb)
    return paths


def stl_lines(mesh: Mesh) -> list[str]:
    """Return the lines of an STL file as most programs write them."""
    lines = ["solid mesh\n"]
    facet = " facet normal {:e} {:e} {:e}\n  outer loop\n" + "   vertex {:e} {:e} {:e}\n" * 3 + "  endloop\n endfacet\n"
    rows = np.column_stack([mesh.face_normals, mesh.corners.reshape(-1, 9)])
    return [*lines, *(facet.format(*row) for row in rows.tolist()), "endsolid mesh\n"]


def obj_lines(faces: np.ndarray, **tables: np.ndarray) -> list[str]:
    """Return the lines of an OBJ file with six decimals, as most programs write them.

    A corner has the same number in each table.
    """
    lines = []
    for keyword, table in tables.items():
        row = keyword + " {:.6f}" * table.shape[1] + "\n"
        lines += [row.format(*values) for values in table.tolist()]
    corner = " {0}" if len(tables) == 1 else " {0}/{0}/{0}"
    row = "f" + "".join(corner.replace("0", str(place)) for place in range(3)) + "\n"
    return [*lines, *(row.format(*face) for face in (faces + 1).tolist())]


class Library:
    """A library in a separate process; `gone` if it is not installed or has crashed."""

    def __init__(self, name: str, python: str | Path, folder: Path) -> None:
        self.name, self._folder = name, folder
        script = Path(__file__).with_name("peer_files.py")
        self._process = subprocess.Popen(
            [python, script, name, str(PAIRS)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    @property
    def gone(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    def seconds(self, verb: str, path: Path | None = None) -> float | None:
        """Return the processor time of a request; None if it failed."""
        if self.gone:
            return None
        assert self._process.stdin and self._process.stdout
        try:
            print(verb, path or "", file=self._process.stdin, flush=True)
            answer = self._process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        if not answer:
            status = self._process.wait()
            print(self.name, "is not installed" if status == MISSING else f"ended with {status}", file=sys.stderr)
            return None
        try:
            return float(answer)
        except ValueError:
            print(self.name, verb, path, answer, file=sys.stderr)
            return None

    def turn(self, verbs: Sequence[str], source: Path) -> dict[str, float | None]:
        """Read a file and apply the other verbs; return the seconds of each."""
        target = self._folder / f"{self.name}-{source.name}"
        found: dict[str, float | None] = {"read": self.seconds("read", source)}
        for verb in verbs[1:]:
            found[verb] = None if found["read"] is None else self.seconds(verb, None if verb == "smooth" else target)
        return found

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def measured(
    libraries: Sequence[Library], verbs: Sequence[str], source: Path, turns: int
) -> dict[str, list[float | None]]:
    """Return the shortest time of each library for each verb."""
    found = [[library.turn(verbs, source) for library in libraries] for _ in range(turns)]
    return {
        verb: [
            min((t for turn in found if (t := turn[number][verb]) is not None), default=None)
            for number in range(len(libraries))
        ]
        for verb in verbs
    }


def table(figures: results.Figures) -> str:
    """Return a row for each task, with our time over that of the fastest other library."""
    ours, *peers = figures["libraries"]
    rows = []
    for title, (mine, *others) in figures["times"].items():
        fastest = min((seconds for seconds in others if seconds is not None), default=None)
        ratio = "" if fastest is None or mine is None else f"{mine / fastest:.2f}"
        rows.append([title, *map(_milliseconds, (mine, *others)), ratio])
    caption = (
        f"{figures['faces']:,} faces; {PAIRS} pairs of steps of Taubin smoothing; the least of several turns; "
        f"{figures['machine']}."
    )
    return f"{caption}\n\n{results.markdown(['', ours, *peers, f'{ours} / fastest other'], rows)}"


def _milliseconds(seconds: float | None) -> str:
    return "" if seconds is None else f"{1000 * seconds:.0f}"


def memory() -> dict[str, Any]:
    """Return the size of a file of each format and the memory for reading it, in bytes."""
    found, program = {}, []
    with tempfile.TemporaryDirectory() as folder:
        meshes = {"small": wavy_torus(20, 10), "large": wavy_torus(*MILLION)}
        for title, extension in FORMATS.items():
            paths = [Path(folder, f"{name}.{extension}") for name in meshes]
            for path, mesh in zip(paths, meshes.values(), strict=True):
                if extension == "text.ply":
                    as_text(path.with_name(path.name.replace(".text", "")), path)
                else:
                    save_mesh(path, mesh)
            done = subprocess.run([sys.executable, "-c", READ, *paths], stdout=subprocess.PIPE, text=True, check=True)
            before, more = map(float, done.stdout.split())
            program.append(before)
            found[title] = [paths[1].stat().st_size, more]
    least = {title: found[title] for title in sorted(found, key=lambda title: found[title][1])}
    return {"faces": len(meshes["large"].faces), "program": [min(program), max(program)], "formats": least}


def as_text(source: Path, target: Path) -> None:
    """Write a PLY file as text."""
    mesh = read(source).mesh
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(mesh.vertices)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    vertices = (f"{x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in mesh.vertices.astype("f4").tolist())
    faces = (f"3 {a} {b} {c}\n" for a, b, c in mesh.faces.tolist())
    target.write_text(head + "".join(vertices) + "".join(faces), encoding="ascii")


def memory_table(figures: results.Figures) -> str:
    """Return a row for each format, in increasing order of memory."""
    program = " to ".join(dict.fromkeys(f"{bytes / 1e6:.0f}" for bytes in figures["program"]))
    rows = [[title, *(f"{bytes / 1e6:.0f} MB" for bytes in found)] for title, found in figures["formats"].items()]
    caption = (
        f"Beyond the {program} MB of the program itself, reading a mesh of {figures['faces']:,} triangles takes at most"
    )
    return f"{caption}\n\n{results.markdown(['file', 'size', 'memory'], rows)}"


if __name__ == "__main__":
    main()
