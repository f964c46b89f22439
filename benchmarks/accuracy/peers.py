"""Measure `auto` beside filters of other libraries: python -m benchmarks.accuracy.peers DIR --truth PATTERN

DIR and PATTERN are those of real.py, and so are the measures. The other libraries are installed into an
environment of their own (--environment) and run by its interpreter, each at its defaults and at the settings of
peer_filters.py, of which the truth then chooses the one with the smallest angle for each mesh. What was
measured of them is kept in --figures; a later run measures what is missing, and methods of this package again.
MeshLib, whose licence is not commercial, is asked only by --meshlib.
"""

import argparse
import json
import signal
import subprocess
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

import cascadenorm as cn
from benchmarks.accuracy.peer_filters import FILTERS
from benchmarks.accuracy.real import errors
from benchmarks.accuracy.results import between_markers
from benchmarks.environments import interpreter
from cascadenorm.geometry.nearest import Surface
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import Mesh

BEGIN, END = "<!-- peers: written by benchmarks/accuracy/peers.py -->", "<!-- end of peers -->"
PACKAGES = ("vtk", "pymeshlab", "trimesh", "scipy", "open3d")
OPTIONAL = "MeshLib"
NOISY = "noisy"
STOPPED = (signal.SIGINT, signal.SIGKILL, signal.SIGTERM)
"""Signals by which somebody has ended a process that did not crash."""
Figure = tuple[float, float]
"""Mean angle in degrees and RMS distance in mean edge lengths."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--truth", required=True, metavar="PATTERN", help="such as models/{shape}.ply")
    parser.add_argument("--environment", type=Path, default=Path("build/peers"), help="of the other libraries")
    parser.add_argument("--figures", type=Path, default=Path("build/peers.json"), help="what was measured of them")
    parser.add_argument("--method", action="append", help="of this package; may be given several times")
    parser.add_argument("--kind", action="append", help="only cases of this kind; may be given several times")
    parser.add_argument("--meshlib", action="store_true", help="install and measure MeshLib as well")
    parser.add_argument("--text", type=Path)
    chosen = parser.parse_args(arguments)
    peers = [name for name in FILTERS if name != OPTIONAL or chosen.meshlib]
    methods = chosen.method or ["auto"]
    kept: dict[str, dict[str, list[Figure | None]]] = {}
    if chosen.figures.exists():
        kept = json.loads(chosen.figures.read_text(encoding="utf-8"))
    cases = sorted(path.parent for path in chosen.folder.glob("*-*/noisy.*"))
    cases = [case for case in cases if not chosen.kind or case.name.split("-")[0] in chosen.kind]
    surfaces: dict[str, tuple[Mesh, Surface]] = {}
    for case in cases:
        shape = case.name.split("-", 1)[1]
        if shape not in surfaces:
            truth = as_mesh(Path(chosen.truth.format(shape=shape)))
            surfaces[shape] = truth, Surface(truth)
        noisy = as_mesh(next(case.glob("noisy.*")))

        def figure(mesh: Mesh, shape: str = shape, edge: float = noisy.mean_edge_length) -> Figure:
            return errors(mesh, *surfaces[shape], edge=edge)

        found = kept.setdefault(case.name, {})
        found[NOISY] = [figure(noisy)]
        missing = [name for name in peers if name not in found]
        if missing:
            python = interpreter(chosen.environment, (*PACKAGES, *(["meshlib"] if chosen.meshlib else [])))
            found.update(_measured(python, noisy, missing, figure))
        for method in methods:
            found[method] = [figure(cn.denoise(noisy, method=method))]
        chosen.figures.parent.mkdir(parents=True, exist_ok=True)
        chosen.figures.write_text(json.dumps(kept, indent=1), encoding="utf-8")
        print(case.name, *(f"{n} {_worded(f[0])}, {_worded(_best(f))};" for n, f in found.items()), flush=True)
    table = peer_table({case.name: kept[case.name] for case in cases}, methods, peers)
    print(table)
    if chosen.text:
        text = chosen.text.read_text(encoding="utf-8")
        chosen.text.write_text(between_markers(text, table, BEGIN, END), encoding="utf-8")


def peer_table(kept: dict[str, dict[str, list[Figure | None]]], methods: Sequence[str], peers: Sequence[str]) -> str:
    """Means of each kind, a row a method; of a peer at its defaults and chosen by the truth."""
    kinds = sorted({case.split("-")[0] for case in kept})
    lines = [f"| mean angle, degrees (RMS, edges) | {' | '.join(kinds)} |", "| --- |" + " ---: |" * len(kinds)]

    def line(title: str, name: str, choose: str) -> str:
        cells = []
        for kind in kinds:
            every = [found[name] for case, found in kept.items() if case.split("-")[0] == kind]
            cells.append(_mean(f[0] if choose == "default" else _best(f) for f in every))
        return f"| {title} | {' | '.join(cells)} |"

    lines += [line(name, name, "default") for name in (NOISY, *methods)]
    for name in peers:
        lines += [line(f"{name}, defaults", name, "default"), line(f"{name}, tuned by the truth", name, "best")]
    return "\n".join(lines)


def _mean(figures: Iterable[Figure | None]) -> str:
    known = [figure for figure in figures if figure is not None]
    return _worded((float(np.mean([f[0] for f in known])), float(np.mean([f[1] for f in known])))) if known else "fails"


def _best(figures: Sequence[Figure | None]) -> Figure | None:
    """Return the figure with the smallest angle."""
    return min((figure for figure in figures if figure is not None), default=None)


def _worded(figure: Figure | None) -> str:
    return "fails" if figure is None else f"{figure[0]:.1f} ({figure[1]:.3f})"


def _measured(python: Path, noisy: Mesh, names: Sequence[str], figure: object) -> dict[str, list[Figure | None]]:
    """Run filters on a mesh by another interpreter, and measure each result; None where one fails."""
    assert callable(figure)
    with tempfile.TemporaryDirectory() as folder:
        given = Path(folder) / "in.npz"
        np.savez(given, vertices=noisy.vertices, faces=noisy.faces)
        script = Path(__file__).with_name("peer_filters.py")
        found: dict[str, list[Figure | None]] = {}
        for name in names:  # each in a process of its own, since some crash
            done = subprocess.run([python, script, given, folder, name], check=False)
            if done.returncode > 0 or -done.returncode in STOPPED:
                raise SystemExit(f"{python} {script.name} ended with {done.returncode}")
            paths = [Path(folder) / f"{name}-{number}.npz" for number in range(len(FILTERS[name][1]))]
            found[name] = [figure(_mesh(path)) if path.exists() else None for path in paths]
        return found


def _mesh(path: Path) -> Mesh:
    arrays = np.load(path)
    return Mesh(arrays["vertices"], arrays["faces"])


if __name__ == "__main__":
    main()
