"""Measure methods on laser scans, each judged by the other scans of the same object.

    python -m benchmarks.accuracy.scans SCANS [--method NAME ...] [--record scans]

SCANS holds a folder for each scan with noisy.*, a triangulated range image, and truth.npz, which has for k of its faces
what the other scans say of them:

rows        (k,) the faces
R, t        rotation (3, 3) and translation (3,) from the scan into the frame of the other arrays
middles     (k, 3) origin of a quadratic fit to the points of the other scans around the face
axes        (k, 3, 3) its axes in rows; the third is the height
size        (k,) unit of length of the fit
coefs       (k, 5) coefficients of u, v, u², uv and v² in the height
halves      (k,) angle between the fits to either half of the other scans, in degrees
raw         (k, 3) mean of the raw face normals of the other scans
scatter     (k,) mean squared distance by which `raw` is uncertain

Three angles are measured, in degrees. `mean` is the mean angle to the quadratic fit, which favours smooth results.
`fair` is the root mean square angle to the raw normals, with their scatter subtracted, so that removing detail which
the other scans saw counts as an error. `fair95` leaves out the worst twentieth of the faces, most of them at
silhouettes.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import results, running
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import Mesh, angles_between, unit

METHODS = ("auto", "bilateral-normal", "guided-normal", "taubin")
NOISY = "noisy"
MEASURES = ("mean", "fair", "fair95")
LARGEST_DISAGREEMENT = 12.0
"""Largest angle in degrees between the fits to either half of the other scans for a face to be judged."""
LARGEST_SCATTER = 0.03
"""Largest scatter of raw normals that are compared."""

Truth = Mapping[str, NDArray[Any]]


def main(arguments: Sequence[str] | None = None) -> None:
    """Denoise each scan by each method, and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="SCANS")
    running.add_methods(parser, METHODS)
    results.add_option(parser)
    options = parser.parse_args(arguments)
    methods = running.chosen_methods(options)
    scans: dict[str, dict[str, list[float]]] = {}
    for place in sorted(path.parent for path in options.folder.glob("*/truth.npz")):
        truth = dict(np.load(place / "truth.npz"))
        noisy = as_mesh(next(place.glob("noisy.*")))
        meshes = {NOISY: noisy, **{method: running.denoised(noisy, method) for method in methods}}
        scans[place.name] = {name: angles(mesh, truth) for name, mesh in meshes.items()}
        print(place.name, *(f"{name} {_formatted(found)};" for name, found in scans[place.name].items()), flush=True)
    if not scans:
        parser.error(f"{options.folder} holds no scans: each is a folder with noisy.* and truth.npz")
    results.report(options.record, {"columns": [NOISY, *methods], "scans": scans}, table)


def angles(mesh: Mesh, truth: Truth) -> list[float]:
    """Return the angles `mean`, `fair` and `fair95` of a scan, whose faces are those of noisy.*, in degrees."""
    placed = Mesh(mesh.vertices @ truth["R"].T + truth["t"], mesh.faces)
    normals = placed.face_normals[truth["rows"]]
    fitted = fitted_normals(placed.centroids[truth["rows"]], truth)
    judged = truth["halves"] < LARGEST_DISAGREEMENT
    mean = np.degrees(angles_between(normals[judged], fitted[judged])).mean()

    known = judged & (truth["scatter"] < LARGEST_SCATTER)  # not where it is NaN
    squares = np.sort(((normals[known] - truth["raw"][known]) ** 2).sum(axis=1) - truth["scatter"][known])
    return [float(mean), _root_mean(squares), _root_mean(squares[: int(0.95 * len(squares))])]


def fitted_normals(points: NDArray[np.float64], truth: Truth) -> NDArray[np.float64]:
    """Return the normal of the quadratic fit of each face below a point, (k, 3)."""
    u, v = np.einsum("kij,kj->ik", truth["axes"], points - truth["middles"])[:2] / truth["size"]
    du, dv, duu, duv, dvv = truth["coefs"].T
    gradient = np.stack([-(du + 2 * duu * u + duv * v), -(dv + duv * u + 2 * dvv * v), np.ones_like(u)], axis=1)
    return np.einsum("ki,kij->kj", unit(gradient), truth["axes"])


def _root_mean(squares: NDArray[np.float64]) -> float:
    """Return the root of a mean of squared distances between unit normals as an angle, in degrees."""
    return float(np.degrees(np.sqrt(max(squares.mean(), 0.0))))


def table(figures: results.Figures) -> str:
    """Return a row for each method: the means of the angles over the scans."""
    scans = figures["scans"]
    rows = []
    for name in figures["columns"]:
        means = np.mean([found[name] for found in scans.values()], axis=0)
        rows.append([name, *(f"{angle:.2f}" for angle in means)])
    return results.markdown([f"mean of {len(scans)} scans, degrees", *MEASURES], rows)


def _formatted(found: Sequence[float]) -> str:
    return " / ".join(f"{angle:.2f}" for angle in found)


if __name__ == "__main__":
    main()
