"""Processor time of reading, writing and Taubin smoothing, beside other libraries.

    python -m benchmarks.speed.file_speed [--environment DIR] [--only KIND]

The other libraries are installed into an environment of their own and run by its interpreter. All of them take turns
at each file, so that whatever else the machine does slows all alike. Each figure is the least of several turns, user
and system time together. The table is printed, and written to benchmarks/file_speed.md.
"""

import argparse
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.environments import interpreter
from benchmarks.speed.peer_files import LIBRARIES, MISSING
from benchmarks.speed.speed import wavy_torus
from cascadenorm.io import read, write
from cascadenorm.io.content import Content
from cascadenorm.io.interop import save_mesh
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons

PACKAGES = ("trimesh", "scipy", "meshio", "pyvista", "open3d", "pymeshlab")
OURS, *PEERS = LIBRARIES
VERBS = {
    "read": "read {}",
    "write": "write {}",
    "replace": "write {}, moved",
    "smooth": "Taubin smoothing",
}
ANEW = ("PLY", "STL", "OBJ", "GLB")
"""Kinds of file that a mesh without a file is written as."""
STEPS = 1000, 500
"""Of the torus: 1,000,000 faces."""
PAIRS = 10
"""Of steps of Taubin smoothing."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure each library in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--environment", type=Path, default=Path("build/peers"), help="of the other libraries")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument(
        "--only", action="append", metavar="KIND", help="kind of file, such as 'OBJ'; may be given several times"
    )
    parser.add_argument("--output", type=Path, default=Path(__file__).parents[1] / "file_speed.md")
    chosen = parser.parse_args(arguments)
    python = interpreter(chosen.environment, PACKAGES)
    mesh = wavy_torus(*STEPS)
    with tempfile.TemporaryDirectory() as folder:
        sources = files(mesh, Path(folder))
        libraries = [Library(name, sys.executable if name == OURS else python, Path(folder)) for name in LIBRARIES]
        rows: dict[str, list[float | None]] = {}
        for title, source in sources.items():
            if chosen.only and title not in chosen.only:
                continue
            verbs = ["read", *(["write"] if title in ANEW else []), "replace", *(["smooth"] if title == "PLY" else [])]
            found = measured(libraries, verbs, source, chosen.turns)
            for verb, times in found.items():
                rows[VERBS[verb].format(title)] = times
                print(verb, title, *map(shown, times), flush=True)
        for library in libraries:
            library.close()
    text = page(rows, len(mesh.faces))
    chosen.output.write_text(text, encoding="utf-8")
    print(text, end="")


def files(mesh: Mesh, folder: Path) -> dict[str, Path]:
    """Write a mesh as each kind of file, in single precision as most are; by title."""
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
    """Spell STL as most programs do."""
    lines = ["solid mesh\n"]
    facet = " facet normal {:e} {:e} {:e}\n  outer loop\n" + "   vertex {:e} {:e} {:e}\n" * 3 + "  endloop\n endfacet\n"
    rows = np.column_stack([mesh.face_normals, mesh.corners.reshape(-1, 9)])
    return [*lines, *(facet.format(*row) for row in rows.tolist()), "endsolid mesh\n"]


def obj_lines(faces: np.ndarray, **tables: np.ndarray) -> list[str]:
    """Spell OBJ with six places, as most programs do; a corner has the same number in each table."""
    lines = []
    for keyword, table in tables.items():
        row = keyword + " {:.6f}" * table.shape[1] + "\n"
        lines += [row.format(*values) for values in table.tolist()]
    corner = " {0}" if len(tables) == 1 else " {0}/{0}/{0}"
    row = "f" + "".join(corner.replace("0", str(place)) for place in range(3)) + "\n"
    return [*lines, *(row.format(*face) for face in (faces + 1).tolist())]


class Library:
    """A library at work in a process of its own; `gone` where it is not installed, or has crashed."""

    def __init__(self, name: str, python: str | Path, folder: Path) -> None:
        self.name, self._folder = name, folder
        script = Path(__file__).with_name("peer_files.py")
        self._process = subprocess.Popen(
            [python, script, name, str(PAIRS)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    @property
    def gone(self) -> bool:
        """Whether nothing more can be asked."""
        return self._process.poll() is not None

    def seconds(self, verb: str, path: Path | None = None) -> float | None:
        """Return the processor time that a request took; None where it fails."""
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
        """Read a file, and do with it what is asked for besides."""
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
    """Return the least time of each library at each verb."""
    found = [[library.turn(verbs, source) for library in libraries] for _ in range(turns)]
    return {
        verb: [
            min((t for turn in found if (t := turn[number][verb]) is not None), default=None)
            for number in range(len(libraries))
        ]
        for verb in verbs
    }


def page(rows: dict[str, list[float | None]], faces: int) -> str:
    """Write the table, with our time over that of the fastest of the others."""
    machine = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    lines = [
        "# Files and Taubin smoothing beside other libraries",
        "",
        f"Processor time of all threads in milliseconds, the least of several turns; {faces:,} faces; "
        f"{PAIRS} pairs of steps of Taubin smoothing; {machine}. "
        "`python -m benchmarks.speed.file_speed` writes this page.",
        "",
        "Here reading includes all checks and the merging of equal corners. The others merge the corners of STL, "
        "all but meshio, and check less. *Moved* is a file written with other positions, everything else in it as it "
        "was, but for normals, which are computed anew; the others write their mesh as they read it. Text is written "
        "here with all digits, elsewhere with fewer.",
        "",
        f"| | {OURS} | {' | '.join(PEERS)} | {OURS} / fastest other |",
        f"| --- |{' ---: |' * (len(LIBRARIES) + 1)}",
    ]
    for title, times in rows.items():
        fastest = min((t for t in times[1:] if t is not None), default=None)
        ratio = "" if fastest is None or times[0] is None else f"{times[0] / fastest:.2f}"
        lines.append(f"| {title} | {' | '.join(map(shown, times))} | {ratio} |")
    return "\n".join(lines) + "\n"


def shown(seconds: float | None) -> str:
    """Write milliseconds, or nothing."""
    return "" if seconds is None else f"{1000 * seconds:.0f}"


if __name__ == "__main__":
    main()
