"""Measure methods on meshes with real kinds of error, and filters of other libraries beside them.

    python -m benchmarks.accuracy.kinds CASES --truth PATTERN [--method NAME ...] [--record real-errors]
    python -m benchmarks.accuracy.kinds CASES --truth PATTERN --peers [--record peers]

CASES holds a folder KIND-SHAPE with noisy.* for each case. PATTERN is the path of the true mesh of a case, in which
{shape} stands for SHAPE; it may have other faces. The records are shown in benchmarks/accuracy.md;
`--record real-errors` also renews the rows of its methods in the record `peers`.

`--peers` installs other libraries into an environment of their own and runs each filter at its defaults and at the
settings in peer_filters.py, of which the one with the smallest angle counts as tuned. Their errors are kept in a file,
so that a later run measures only what is missing. MeshLib is measured only with `--meshlib`, since its licence excludes
commercial use.
"""

import argparse
import json
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import results, running
from benchmarks.accuracy.peer_filters import FILTERS
from benchmarks.environments import interpreter
from cascadenorm.geometry.nearest import SurfaceTree
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import Mesh, angles_between

METHODS = ("auto", "cascade", "guided-normal", "bilateral-normal")
PACKAGES = ("vtk", "pymeshlab", "trimesh", "scipy", "open3d")
OPTIONAL = "MeshLib"
REAL_ERRORS, PEERS = "real-errors", "peers"
"""Names of records."""
NOISY = "noisy"
HEADING = "mean angle, degrees (RMS, edges)"
STOPPED = (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGKILL", signal.SIGTERM))
"""Signals by which a user stops a process; such a process has not crashed."""

Errors = Sequence[float]
"""Mean angle in degrees and RMS distance in mean edge lengths."""
Measured = dict[str, list[Errors | None]]
"""Errors of each method or filter at each of its settings; None if it failed."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure each case, and print the means of each kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="CASES")
    parser.add_argument("--truth", required=True, metavar="PATTERN", help="such as models/{shape}.ply")
    running.add_methods(parser, METHODS)
    parser.add_argument("--kind", action="append", help="only cases of this kind; may be given several times")
    parser.add_argument("--results", type=Path, help="folder of denoised cases, KIND-SHAPE.*, instead of methods")
    parser.add_argument("--peers", action="store_true", help="measure filters of other libraries as well")
    parser.add_argument("--meshlib", action="store_true", help="install and measure MeshLib as well")
    parser.add_argument("--environment", type=Path, default=Path("build/peers"), help="of the other libraries")
    parser.add_argument("--kept", type=Path, default=Path("build/peers.json"), help="errors of the other libraries")
    results.add_option(parser)
    options = parser.parse_args(arguments)
    peers = [name for name in FILTERS if name != OPTIONAL or options.meshlib] if options.peers else []
    methods = [] if options.results else options.method or (METHODS[:1] if peers else METHODS)
    kept = Kept(options.kept)
    cases: dict[str, Measured] = {}
    truths: dict[str, Truth] = {}
    for place in sorted(path.parent for path in options.folder.glob("*-*/noisy.*")):
        kind, shape = place.name.split("-", 1)
        if options.kind and kind not in options.kind:
            continue
        if shape not in truths:
            mesh = as_mesh(Path(options.truth.format(shape=shape)))
            truths[shape] = Truth(mesh, SurfaceTree(mesh))
        noisy = as_mesh(next(place.glob("noisy.*")))

        def errors_of(mesh: Mesh, truth: Truth = truths[shape], edge: float = noisy.mean_edge_length) -> Errors:
            return errors(mesh, truth, edge=edge)

        found: Measured = {NOISY: [errors_of(noisy)]}
        found |= {method: [errors_of(running.denoised(noisy, method))] for method in methods}
        if options.results:
            found[options.results.name] = [errors_of(as_mesh(next(options.results.glob(f"{place.name}.*"))))]
        if missing := [name for name in peers if name not in kept.of(place.name)]:
            python = interpreter(options.environment, (*PACKAGES, *(["meshlib"] if options.meshlib else [])))
            kept.add(place.name, of_peers(python, noisy, missing, errors_of))
        found |= {name: kept.of(place.name)[name] for name in peers}
        cases[place.name] = found
        print(place.name, *(f"{name} {_formatted(_best(every))};" for name, every in found.items()), flush=True)
    figures = figures_of(cases)
    results.report(options.record, figures, peer_table if peers else table)
    if options.record == REAL_ERRORS:
        renew_peers(figures)


class Truth(NamedTuple):
    """A true mesh, and its surface for searches."""

    mesh: Mesh
    surface: SurfaceTree


def errors(mesh: Mesh, truth: Truth, *, edge: float) -> Errors:
    """Return the mean angle by area to the nearest true faces, and the RMS distance to the true surface in edges."""
    theirs = truth.mesh.face_normals[truth.surface.nearest(mesh.centroids).faces]
    known = mesh.face_normals.any(axis=1) & theirs.any(axis=1)
    angle = np.degrees(np.average(angles_between(mesh.face_normals[known], theirs[known]), weights=mesh.areas[known]))
    distances = truth.surface.nearest(mesh.vertices[mesh.topology.used_vertices]).distances
    return float(angle), float(np.sqrt(np.mean(distances**2)) / edge)


def figures_of(cases: Mapping[str, Measured]) -> dict[str, Any]:
    """Return the means of each row over the cases of each kind. Filters have one row with defaults and one tuned."""
    kinds: dict[str, list[Measured]] = {}
    for case, found in cases.items():
        kinds.setdefault(case.split("-")[0], []).append(found)
    rows: dict[str, dict[str, Errors | None]] = {}
    for kind, every in sorted(kinds.items()):
        for name in every[0]:
            if name in FILTERS:
                rows.setdefault(f"{name}, defaults", {})[kind] = _mean(found[name][0] for found in every)
                rows.setdefault(f"{name}, oracle-tuned", {})[kind] = _mean(_best(found[name]) for found in every)
            else:
                rows.setdefault(name, {})[kind] = _mean(_best(found[name]) for found in every)
    return {"kinds": {kind: len(kinds[kind]) for kind in sorted(kinds)}, "means": rows}


def renew_peers(figures: results.Figures, *, root: Path = results.ROOT) -> None:
    """Replace the rows of methods in the record of other libraries, if it has the same cases."""
    peers = results.read(PEERS, root=root)
    if peers["kinds"] == figures["kinds"]:
        peers["means"] |= {name: row for name, row in figures["means"].items() if name in peers["means"]}
        results.write(PEERS, peers, root=root)
        results.show(PEERS, root=root)


def table(figures: results.Figures) -> str:
    """Return a row for each kind, a column for each method."""
    means = figures["means"]
    rows = [
        [f"{kind} ({count})", *(_formatted(row[kind]) for row in means.values())]
        for kind, count in figures["kinds"].items()
    ]
    return results.markdown([HEADING, *means], rows)


def peer_table(figures: results.Figures) -> str:
    """Return a row for each method or filter, a column for each kind."""
    kinds = figures["kinds"]
    rows = [[name, *(_formatted(row[kind]) for kind in kinds)] for name, row in figures["means"].items()]
    return results.markdown([HEADING, *kinds], rows)


def _mean(every: Iterable[Errors | None]) -> Errors | None:
    known = [errors for errors in every if errors is not None]
    return [float(mean) for mean in np.mean(known, axis=0)] if known else None


def _best(every: Sequence[Errors | None]) -> Errors | None:
    """Return the errors with the smallest angle."""
    return min((errors for errors in every if errors is not None), default=None)


def _formatted(errors: Errors | None) -> str:
    return "fails" if errors is None else f"{errors[0]:.1f} ({errors[1]:.3f})"


class Kept:
    """Errors of the filters of other libraries on each case, kept in a file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._cases: dict[str, Measured] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}

    def of(self, case: str) -> Measured:
        """Return the recorded errors on a case."""
        return self._cases.get(case, {})

    def add(self, case: str, found: Measured) -> None:
        """Record the errors on a case."""
        self._cases[case] = self.of(case) | found
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._path.write_text(json.dumps(self._cases, indent=1), encoding="utf-8")


def of_peers(python: Path, noisy: Mesh, names: Sequence[str], errors_of: Callable[[Mesh], Errors]) -> Measured:
    """Run filters on a mesh with another interpreter, and measure the results of each setting."""
    script = Path(__file__).with_name("peer_filters.py")
    found: Measured = {}
    with tempfile.TemporaryDirectory() as folder:
        given = Path(folder, "in.npz")
        np.savez(given, vertices=noisy.vertices, faces=noisy.faces)
        for name in names:  # each in a process of its own, since some crash
            done = subprocess.run([python, script, given, folder, name], check=False)
            if done.returncode > 0 or -done.returncode in STOPPED:
                raise SystemExit(f"{python} {script.name} ended with {done.returncode}")
            paths = [Path(folder, f"{name}-{number}.npz") for number in range(len(FILTERS[name][1]))]
            found[name] = [errors_of(_mesh(path)) if path.exists() else None for path in paths]
    return found


def _mesh(path: Path) -> Mesh:
    arrays = np.load(path)
    return Mesh(arrays["vertices"], arrays["faces"])


if __name__ == "__main__":
    main()
