"""Run this package and others on malformed meshes, as arrays and as files.

    python -m benchmarks.robustness.malformed arrays [--python FILE] [--record]
    python -m benchmarks.robustness.malformed files [FOLDER ...] [--method NAME]
    python -m benchmarks.robustness.malformed random [--minutes 60] [--seed SEED]

`arrays` runs each tool on each mesh of dirty_meshes.py in a process of its own, with a limit of processor time and of
memory, on arrays in memory and at its defaults. The table is that of benchmarks/dirty_input.md. Tools that the given
Python does not have get no column.

`files` denoises a few hundred files on the command line: the same meshes and others, in every format and with colours
and other values, and mesh files in the given folders. Each file must be denoised within two minutes, without a
traceback, and keep its faces and values. Prints the outcomes; the exit status is 1 if a guarantee was broken.

`random` damages files and meshes at random for some minutes. Every case is a seed. The first failing case at each place
in the code is written to a folder, with its seed and traceback; `--seed` runs one of them again.
tests/benchmarks/test_fuzz.py does the same for seconds.
"""

import argparse
import contextlib
import io
import re
import resource
import secrets
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cascadenorm as cn
from benchmarks import results
from benchmarks.robustness.dirty_meshes import Dirty, dirty_meshes
from cascadenorm.cli import run
from cascadenorm.io import MeshFile
from cascadenorm.io.content import Content
from cascadenorm.io.files import OPTIONAL, output_format
from cascadenorm.io.files import write as write_file
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh.polygons import Polygons

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "helpers"))

import damage
from shapes import cube, grid, icosphere, noisy

LIMIT_S = 120  # for a mesh: of processor time as arrays or at random, of wall time as a file
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

FORMATS = ("ply", "obj", "stl", "off", "glb", "gltf", "vtk", "vtu", "3mf", "dae")
UNREADABLE, INVALID = 3, 4

REFUSALS = ("a vertex is", "a face references", "no vertices", "points without")
"""First words of the descriptions of meshes that may be refused."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure every tool that is installed, or denoise files; return 1 if a file or a case broke a guarantee."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    arrays = commands.add_parser("arrays", help="in several tools")
    arrays.add_argument("--python", default=sys.executable, help="the Python in which the other tools are installed")
    results.add_option(arrays, "malformed")
    files = commands.add_parser("files", help="on the command line")
    files.add_argument("folders", nargs="*", type=Path, help="further mesh files are looked for in these")
    files.add_argument("--method", default="auto")
    fuzz = commands.add_parser("random", help="damaged at random")
    fuzz.add_argument("--minutes", type=float, default=1.0)
    fuzz.add_argument("--seed", type=int, help="one case alone, with its traceback")
    fuzz.add_argument("--output", type=Path, default=Path("fuzz-failures"))
    options = parser.parse_args(arguments)
    if options.command == "random":
        warnings.simplefilter("error")
        if options.seed is None:
            return failing_cases(options.minutes, options.output)
        print(case(options.seed))
        return 0
    if options.command == "files":
        return broken_guarantees(options.folders, options.method)
    results.report(options.record, in_tools(options.python), table)
    return 0


def in_tools(python: str) -> dict[str, Any]:
    """Return the outcome of each installed tool on each mesh."""
    pythons = {name: sys.executable if name == OURS else python for name in TOOLS}
    versions = {name: found for name, python in pythons.items() if (found := version(name, python))}
    columns = {f"{name} {found}": measured(name, pythons[name]) for name, found in versions.items()}
    inputs = {mesh: [column[mesh] for column in columns.values()] for mesh in dirty_meshes()}
    return {"tools": list(columns), "inputs": inputs}


def table(figures: results.Figures) -> str:
    """Return a row for each mesh."""
    rows = [[mesh, *outcomes] for mesh, outcomes in figures["inputs"].items()]
    return results.markdown(["input", *figures["tools"]], rows, numbers=False)


def version(name: str, python: str) -> str:
    """Return the version of a tool; empty if it cannot be imported."""
    code = f"import importlib.metadata, {name}; print(importlib.metadata.version({name!r}))"
    return subprocess.run([python, "-c", code], capture_output=True, text=True).stdout.strip()


def measured(name: str, python: str) -> dict[str, str]:
    """Return a description of the outcome of a tool on each mesh."""
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
    """Return the vertices from a tool, or a description of how it failed."""
    ended = int(Path(f"{file}.signal").read_text())
    if ended:
        return f"**no end within {LIMIT_S} s**" if ended == signal.SIGXCPU else f"**the process dies** (signal {ended})"
    refusal = Path(f"{file}.error")
    if refusal.exists():
        return "refused: " + " ".join(refusal.read_text().replace("|", "/").split())[:LONGEST]
    return np.load(f"{file}.npy")


def judged(dirty: Dirty, out: np.ndarray, at_origin: np.ndarray) -> str:
    """Describe a result: how many vertices are lost, not finite or far away, or that there is no defect."""
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


def broken_guarantees(folders: Sequence[Path], method: str) -> int:
    """Denoise the files; return 1 if a guarantee was broken."""
    signal.signal(signal.SIGALRM, _hanging)
    outcomes: Counter[str] = Counter()
    broken = 0
    slowest = (0.0, "")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for path, must_work in [*made(folder), *found(folders)]:
            output = folder / f"{path.stem}_denoised{path.suffix}"
            start = time.monotonic()
            signal.alarm(LIMIT_S)
            try:
                outcome, problem = tried(path, output, method, must_work=must_work)
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
    """Write malformed meshes in every format; yield each path, and whether denoising must succeed."""
    formats = [format for format in FORMATS if format not in OPTIONAL or _is_written(format)]
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
    """Denoise a file; return the outcome as one word, and the guarantee that was broken, if any."""
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
    """Return what differs apart from positions and normals; empty if nothing does."""
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


def failing_cases(minutes: float, output: Path) -> int:
    """Run random cases until the time is up; return 1 if any failed."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGPROF, _hanging)
    end = time.monotonic() + 60 * minutes
    outcomes: Counter[str] = Counter()
    failures: Counter[str] = Counter()
    while time.monotonic() < end:
        seed = secrets.randbelow(2**63)
        signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
        try:
            outcomes[case(seed)] += 1
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(frame.filename).name}-{frame.lineno}-{type(error).__name__}"
            if place not in failures:
                output.mkdir(parents=True, exist_ok=True)
                text = "".join(traceback.format_exception(error))
                (output / f"{place}.txt").write_text(f"--seed {seed}\n\n{text}", encoding="utf-8")
            failures[place] += 1
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
    for name, count in [*outcomes.most_common(), *failures.items()]:
        print(f"{count:8} {name}")
    return int(bool(failures))


def case(seed: int) -> str:
    """Denoise a damaged mesh or sample file; return its description, and whether it was denoised or refused."""
    from sample_files import SAMPLES, SAMPLES_FORMAT  # needs pytest
    from usd_layers import SCENE, archive, stored
    from xml_files import COLLADA, entries, nested_3mf

    rng = np.random.default_rng(seed)
    if rng.random() < 0.3:
        return f"mesh {'done' if damage.denoised(rng) == 'done' else 'refused'}"
    model, scene = "3D/3dmodel.model", SCENE.encode()
    scenes = {"3mf": entries(nested_3mf())[model], "dae": COLLADA.encode(), "usda": scene, "usdz": scene}
    packed = {
        "3mf": lambda content: nested_3mf({model: content}),
        "usdz": lambda layer: archive({"layer.usda": layer}),
    }
    samples = {**SAMPLES, **scenes, "usdc": stored(scene, "usdc")}
    name = sorted(samples)[rng.integers(len(samples))]
    others = list(samples.values())
    read = damage.read_damaged(SAMPLES_FORMAT.get(name, name), samples[name], rng, others, packed.get(name, bytes))
    return f"{name} {'read' if read == 'read' else 'refused'}"


def _hanging(*_: object) -> None:
    raise TimeoutError(f"no end after {LIMIT_S} seconds")


if __name__ == "__main__":
    sys.exit(main())
