"""Denoise a few hundred malformed files of all formats on the command line.

    python -m benchmarks.robustness.corpus [FOLDER ...] [--method NAME]

The files are generated: the malformed meshes of dirty_meshes.py and others, in every format and with colours and other
values. Mesh files in the given folders are used as well. Each file must be denoised within two minutes, without a
traceback, and keep its faces and values. Prints the outcomes; the exit status is 1 if a guarantee was broken.
"""

import argparse
import contextlib
import io
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cascadenorm as cn
from benchmarks.robustness.dirty_meshes import dirty_meshes
from cascadenorm.cli import run
from cascadenorm.io import MeshFile
from cascadenorm.io.content import Content
from cascadenorm.io.files import NEEDS, output_format
from cascadenorm.io.files import write as write_file
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh.polygons import Polygons

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

import damage
from shapes import cube, grid, icosphere, noisy

LIMIT_S = 120
FORMATS = ("ply", "obj", "stl", "off", "glb", "gltf", "vtk", "vtu", "3mf", "dae")
UNREADABLE, INVALID = 3, 4

REFUSALS = ("a vertex is", "a face references", "no vertices", "points without")
"""First words of the meshes that may be refused."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Denoise the files; return 1 if a guarantee was broken."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, help="further mesh files are looked for in these")
    parser.add_argument("--method", default="auto")
    chosen = parser.parse_args(arguments)
    signal.signal(signal.SIGALRM, _hanging)
    outcomes: Counter[str] = Counter()
    broken = 0
    slowest = (0.0, "")
    with tempfile.TemporaryDirectory() as folder:
        for path, must_work in [*made(Path(folder)), *found(chosen.folders)]:
            output = Path(folder) / f"{path.stem}_denoised{path.suffix}"
            start = time.monotonic()
            signal.alarm(LIMIT_S)
            try:
                outcome, problem = tried(path, output, chosen.method, must_work=must_work)
            except Exception as error:
                outcome, problem = "error", f"{type(error).__name__}: {error}"
            finally:
                signal.alarm(0)
            slowest = max(slowest, (time.monotonic() - start, path.name))
            outcomes[f"{path.suffix[1:]} {outcome}"] += 1
            if problem:
                broken += 1
                print(f"{path.name}: {problem}", flush=True)
            output.unlink(missing_ok=True)
    for name, count in sorted(outcomes.items()):
        print(f"{count:5} {name}")
    print(f"{outcomes.total()} files, {broken} broken guarantees; the slowest took {slowest[0]:.1f} s ({slowest[1]})")
    return int(broken > 0)


def made(folder: Path) -> Iterator[tuple[Path, bool]]:
    """Write malformed meshes in every format; yield each path, and whether it has to be denoised."""
    formats = [format for format in FORMATS if format not in NEEDS or _is_written(format)]
    rng = np.random.default_rng(0)
    meshes = {name: (dirty.vertices, dirty.faces) for name, dirty in dirty_meshes().items()}
    for spoil in damage.SPOILT:
        for shape, base in {"ball": icosphere(2), "sheet": grid(16, 5), "box": cube(4)}.items():
            mesh = noisy(base, 0.2)
            meshes[f"{shape}{spoil.__name__}"] = spoil(mesh.vertices, mesh.faces.astype(np.int64), rng)
    large = noisy(icosphere(5), 0.2)
    meshes["large"] = large.vertices, large.faces.astype(np.int64)
    for name, (vertices, faces) in meshes.items():
        content = _content(vertices, faces, rng)
        for format in formats:
            path = folder / f"{re.sub(r'[^a-z0-9]+', '_', name)}.{format}"
            with contextlib.suppress(cn.OutputError, cn.MeshError):  # what the format cannot hold
                yield _written(content, path), not name.startswith(REFUSALS)


def found(folders: Sequence[Path]) -> Iterator[tuple[Path, bool]]:
    """Yield the mesh files in folders."""
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.suffix[1:].lower() in FORMATS and path.is_file():
                yield path, False


def tried(path: Path, output: Path, method: str, *, must_work: bool) -> tuple[str, str]:
    """Denoise a file; return the outcome in a word, and the guarantee that was broken, if any."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run(["denoise", str(path), "-o", str(output), "--method", method, "--force"])
    messages = err.getvalue().strip()
    if code in (UNREADABLE, INVALID):
        return "refused", messages if must_work else ""
    if code != 0 or any(word in messages for word in ("please report", "Traceback", "Warning")):
        return "failed", f"exit code {code}: {messages}"
    if path.suffix == ".dae":  # trimesh joins vertices that are closer than 1e-8 when it reads them
        return "done", ""
    return "done", _difference(cn.read(path), cn.read(output))


def _difference(before: MeshFile, after: MeshFile) -> str:
    """Return what differs besides positions and normals; empty if nothing does."""
    if not np.isfinite(after.positions).all():
        return "a position is not finite"
    if before.positions.shape != after.positions.shape:
        return f"{len(before.positions)} vertices became {len(after.positions)}"
    if not np.array_equal(before.polygons.corners, after.polygons.corners):
        return "faces differ"
    a, b = before.content(), after.content()
    for old, new in ((a.vertex_values, b.vertex_values), (a.face_values, b.face_values)):
        if old.keys() != new.keys():
            return f"values differ: {sorted(old)} became {sorted(new)}"
        for name in old.keys() - {"nx", "ny", "nz"}:
            if not np.array_equal(old[name], new[name], equal_nan=True):
                return f"values differ: {name}"
    return ""


def _content(vertices: NDArray[Any], faces: NDArray[np.int64], rng: np.random.Generator) -> Content:
    colors = {name: rng.integers(0, 256, len(vertices)).astype(np.uint8) for name in ("red", "green", "blue")}
    values = {**colors, "quality": rng.normal(size=len(vertices))}
    return Content(vertices, Polygons.from_rows(faces), values, {"part": rng.integers(9, size=len(faces))})


def _written(content: Content, path: Path) -> Path:
    write_file(PlyFile(b"".join(PlyFile.encode(content)[0])), path, force=True)
    return path


def _is_written(format: str) -> bool:
    try:
        output_format(f"a.{format}")
    except cn.OutputError:
        return False
    return True


def _hanging(*_: object) -> None:
    raise TimeoutError(f"no end after {LIMIT_S} seconds")


if __name__ == "__main__":
    sys.exit(main())
