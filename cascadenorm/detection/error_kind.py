"""Classification of the error of a mesh; a new kind is added to `NameOfKind` and `error_kind`."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from cascadenorm.detection.segmentation_steps import has_voxel_faces, is_segmentation
from cascadenorm.detection.voxel_lattice import VoxelLattice, lattice_of_grey_values, lattice_of_mask
from cascadenorm.mesh import Floats, Ints, Mesh, Vectors, kernel, marked, parallel_for
from cascadenorm.mesh.vectors import row, squared_distance

NameOfKind = Literal["none", "independent", "correlated", "segmentation", "volume", "depth image"]
"""Kinds of error.

`none`: no significant error. `independent`: independent errors of the vertices. `correlated`: errors correlated over
several edges. `segmentation`: steps of a binary mask. `volume`: an isosurface of a grey volume, such as a tomogram or
fused depth images. `depth image`: a measured surface seen from one side, by a depth camera or a laser scanner.
"""

LEAST_ERROR = 0.01  # RMS error in mean edge lengths below which the kind is `none`
OPEN = 0.3, 0.5  # limits of |Σ A n| / Σ A above which a mesh is probably, and certainly, seen from one side
INDEPENDENT = 1.0  # correlation length in mean edge lengths below which noise counts as independent
UNSURE = 0.7, 1.5  # range of correlation lengths, in mean edge lengths, in which the classification is uncertain
PAIRS = 4000  # number of vertices, evenly spaced in order, around which the correlation is measured
CORRELATION_REACHES = 3.0, 12.0  # largest distances, in mean edge lengths, up to which the correlation is measured


@dataclass(frozen=True, kw_only=True)
class ErrorKind:
    """The kind of error of a mesh, with measurements."""

    kind: NameOfKind
    sure: bool  # whether the classification is certain
    size: float  # root mean square of the displacement along the normals, in mean edge lengths of the denoised mesh
    # correlation length in mean edge lengths, where the autocorrelation falls to 1/e; None if there is no error
    length: float | None
    # edge lengths of a voxel along the axes of its lattice, in mesh units; None if no lattice was found
    voxel: tuple[float, float, float] | None

    def __str__(self) -> str:
        """Return a short description, such as "independent noise of 0.2 edges"."""
        unsure = "" if self.sure else "probably "
        if self.kind == "none":
            return "no significant error"
        edges = f"of {self.size:.2g} edges"
        if self.kind == "independent":
            return f"{unsure}independent noise {edges}"
        if self.kind == "correlated":
            return f"{unsure}error {edges}, correlated over about {self.length:.2g} edges"
        if self.kind == "depth image":
            return f"{unsure}error {edges} in a depth image or a laser scan"
        voxels = " with voxels of " + " × ".join(f"{side:.3g}" for side in self.voxel) if self.voxel else ""
        if self.kind == "segmentation":
            return f"{unsure}steps {edges} from a binary segmentation{voxels}"
        return f"{unsure}error {edges} in a surface from a grey volume{voxels}"


def error_kind(mesh: Mesh, denoised: Vectors, *, exponent: int = 0, measured: bool | None = None) -> ErrorKind:
    """Classify the error of a mesh from its vertices and their positions denoised by the reference method, (n, 3).

    The mesh was scaled by 2**-exponent; voxel sizes are given in its original unit. `measured` is whether the triangles
    are those of a measured surface; None if that is unknown. An open sheet is a depth image unless it is False.
    """
    used, true = mesh.topology.used_vertices, mesh.moved(denoised)
    error = np.einsum("ij,ij->i", mesh.vertices - denoised, true.vertex_normals)[used]
    edge = true.mean_edge_length  # noise increases the edge length of the input
    size = float(np.sqrt(np.mean(error**2)) / edge) if edge > 0 and len(error) else 0.0
    if size < LEAST_ERROR:
        return ErrorKind(kind="none", sure=True, size=size, length=None, voxel=None)
    length = correlation_length(denoised[used] / edge, error)
    openness = float(np.linalg.norm(mesh.area_vectors.sum(axis=0)) / mesh.area)
    kind: NameOfKind
    if (lattice := lattice_of_mask(mesh)) is not None:
        kind, sure = "segmentation", True
    elif (lattice := lattice_of_grey_values(mesh)) is not None:
        kind, sure = "volume", True
    elif has_voxel_faces(mesh):
        kind, sure = "segmentation", True
    elif openness <= OPEN[1] and is_segmentation(mesh):  # unknown voxel size, after surface nets or decimation
        kind, sure = "segmentation", False
    elif openness > OPEN[0] and measured is not False:
        kind, sure = "depth image", openness > OPEN[1] and measured is True
    else:
        kind, sure = "independent" if length < INDEPENDENT else "correlated", not UNSURE[0] < length < UNSURE[1]
    return ErrorKind(
        kind=kind, sure=sure, size=size, length=length, voxel=None if lattice is None else _voxel(lattice, exponent)
    )


def _voxel(lattice: VoxelLattice, exponent: int) -> tuple[float, float, float] | None:
    a, b, c = np.ldexp(np.linalg.norm(lattice, axis=1), exponent).tolist()
    return (a, b, c) if np.isfinite([a, b, c]).all() else None


def correlation_length(points: Vectors, values: Floats) -> float:
    """Return the distance at which the autocorrelation of values, (n,), not all zero, at points, (n, 3), falls to 1/e.

    The positions and the result are in mean edge lengths, with linear interpolation between bins. It is at most the
    last of CORRELATION_REACHES. Most errors are correlated over less than the first one, which takes a fraction of the
    time and gives the same result.
    """
    for reach in CORRELATION_REACHES:
        at, correlation = autocorrelation(points, values, reach)
        below = np.flatnonzero(correlation < np.exp(-1))
        if len(below) > 0 and at[below[0]] < reach:  # the last bin, at the reach, is half as wide
            break
    if len(below) == 0:
        return CORRELATION_REACHES[-1]
    i = int(below[0])
    share = (correlation[i - 1] - np.exp(-1)) / (correlation[i - 1] - correlation[i])
    return float(at[i - 1] + share * (at[i] - at[i - 1]))


def autocorrelation(points: Vectors, values: Floats, reach: float) -> tuple[Floats, Floats]:
    """Return distances up to the reach, from 0, and the autocorrelation of values, (n,), at points, (n, 3), there.

    Bins are as wide as the unit of the points; those without a pair of points are left out.
    """
    # bins of each centre, with points sorted along the axis of their largest extent
    axis = int(np.argmax(np.ptp(points, axis=0)))
    order = np.argsort(points[:, axis], kind="stable")
    chosen = marked(np.linspace(0, len(points) - 1, min(PAIRS, len(points))).astype(np.int64), len(points))
    centers = np.flatnonzero(chosen[order])
    binned = np.zeros((2, len(centers), int(reach) + 1))
    parallel_for(len(centers), _bins_range, centers, points[order], axis, values[order], reach, binned, smallest=64)
    counts, sums = binned.sum(axis=1)
    means = sums / np.maximum(counts, 1)
    known = np.flatnonzero(counts[1:]) + 1
    correlation = np.concatenate([[1.0], means[known] / np.mean(values**2)])
    return np.concatenate([[0.0], known.astype(np.float64)]), correlation


@kernel
def _bins_range(
    start: int, stop: int, centers: Ints, points: Vectors, axis: int, values: Floats, reach: float, binned: Floats
) -> None:
    """Bin the points after each centre by rounded distance: their numbers, and the sums of the products of values.

    The points are sorted along the axis, so near points are close in order. Each pair counts for its earlier point.
    """
    near, squares = np.empty(len(points), np.int32), np.empty(len(points))
    for i in range(start, stop):
        center = centers[i]
        k, found = center + 1, 0
        while k < len(points) and points[k, axis] - points[center, axis] <= reach:
            near[found] = k
            squares[found] = squared_distance(row(points, k), row(points, center))
            found += squares[found] <= reach * reach  # a branch would be mispredicted often
            k += 1
        for place in range(found):
            distance = int(np.rint(np.sqrt(squares[place])))  # the first neighbours are in bin 1
            binned[0, i, distance] += 1
            binned[1, i, distance] += values[center] * values[near[place]]
