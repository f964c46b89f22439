"""Surfaces that were computed, not measured: their triangles are coplanar with a neighbour, as CAD leaves them, or bend
evenly, as chords of a smooth surface."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.detection.chords import Chords, chords, error_shares, error_sums
from cascadenorm.detection.rounding import rounding
from cascadenorm.detection.segmentation_steps import is_segmentation
from cascadenorm.mesh import Bools, Floats, Index, Ints, Ints32, Mesh, Vectors, kernel, parallel_for, sums_in_blocks
from cascadenorm.mesh.vectors import length, row, subtract

FACES, AREA = 0.2, 0.5
"""Shares of the triangles, and of the area, of a component that have a coplanar neighbour, from which it is exact."""
UNEVEN, UNEVEN_CURVED = 0.5, 0.35
"""Coefficients of variation of the edge lengths, above which flat and curved surfaces are as CAD kernels mesh them."""
EVEN_AREA = 0.8
"""In place of AREA where triangles are even: those of a depth image with coarse disparities are coplanar, too."""
ERROR, ERROR_FLAT = 0.55, 0.75
"""Share of error in the chords of a component (see `error_shares`), up to which it is exact; the second one where SOME
of its triangles have a coplanar neighbour, which no noise leaves."""
SOME = 0.1
CREASED = 0.1
"""Share of the edges that do not join smooth vertices, from which a component has creases."""


def exact_vertices(mesh: Mesh, measured: Chords | None = None) -> NDArray[np.bool_]:
    """Tell which vertices belong to components that were computed and carry no error.

    Noise, however small, leaves no two triangles coplanar; CAD kernels triangulate planar and ruled faces, so that most
    triangles have a coplanar neighbour. Segmentations have too. They are told by three properties together (see
    `is_segmentation`), of which a box with a grid on its sides, or a plate with many equal holes, lacks one.

    Where faces are curved twice no triangles are coplanar. There edges are chords of a smooth surface (see `chords`),
    and most bend the same way; noise bends them to and fro. A smooth error that is wider than many edges looks like
    shape; so such a component must also have coplanar triangles, uneven ones, or creases.

    Parameters
    ----------
    mesh : n vertices
    measured : its chords, where they are known

    Returns
    -------
    (n,) bool; vertices without a face are not exact
    """
    exact = np.zeros(len(mesh.vertices), bool)
    computed = computed_components(mesh, measured).computed
    exact[mesh.faces[computed[mesh.topology.face_components]]] = True
    return exact


class Components(NamedTuple):
    """Of each connected component: whether it was computed, and how many of its edges have two faces, (c,)."""

    computed: Bools
    edges: Ints


def computed_components(mesh: Mesh, measured: Chords | None = None) -> Components:
    """Tell which components were computed and carry no error, as `exact_vertices` describes it.

    Parameters
    ----------
    measured : the chords of the mesh, where they are known
    """
    measured = measured or chords(mesh)
    sums = {**_shape_sums(mesh), **error_sums(mesh, measured)}
    faces = sums["coplanar"] / np.maximum(sums["faces"], 1)
    covered = sums["coplanar area"] / np.maximum(sums["area"], np.finfo(float).tiny)
    unevenness = _unevenness(sums)
    flat = (faces >= FACES) & (covered >= AREA) & ((unevenness > UNEVEN) | (covered >= EVEN_AREA))
    error = error_shares(mesh, sums, measured)
    creased = (sums["edges"] - sums["smooth"]) / np.maximum(sums["edges"], 1)
    smooth = (error <= ERROR) & ((unevenness > UNEVEN_CURVED) | (creased >= CREASED))
    computed = flat | smooth | ((error <= ERROR_FLAT) & (faces >= SOME))
    if computed.any() and is_segmentation(mesh):
        computed[:] = False
    return Components(computed, sums["edges"])


def coplanar_neighbors(mesh: Mesh) -> NDArray[np.int8]:
    """Count the neighbours across its edges with which each face lies in one plane, (m,)."""
    out = np.empty(len(mesh.faces), np.int8)
    limit = rounding(mesh)
    across = mesh.topology.faces_across
    parallel_for(len(out), _coplanar_range, mesh.vertices, mesh.faces, mesh.face_normals, across, limit, out)
    return out


def _shape_sums(mesh: Mesh) -> dict[str, NDArray[Any]]:
    """Sums over the faces of each component, (c,), and over their sides, (c, 2)."""
    component, coplanar = mesh.topology.face_components, coplanar_neighbors(mesh)

    def add(start: int, stop: int, sums: Floats) -> None:
        _shape_range(start, stop, component, mesh.vertices, mesh.faces, mesh.areas, coplanar, sums)

    sums = sums_in_blocks(len(component), (int(component.max()) + 1, 6), add)
    names = "faces", "coplanar", "area", "coplanar area"
    return {**dict(zip(names, sums.T, strict=False)), "lengths": sums[:, 4:]}


def _unevenness(sums: Mapping[str, NDArray[Any]]) -> Floats:
    """Coefficient of variation of the edge lengths of each component, (count,)."""
    mean, square = (sums["lengths"] / np.maximum(3 * sums["faces"], 1)[:, None]).T
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0)) / np.maximum(mean, np.finfo(float).tiny))


@kernel
def _shape_range(
    start: int,
    stop: int,
    component: Ints32,
    vertices: Vectors,
    faces: Ints32,
    areas: Floats,
    coplanar: NDArray[np.int8],
    sums: Floats,
) -> None:
    """Add to the sums of each component how many faces it has and their area.

    Then the same of those with coplanar neighbours, the lengths of sides, and their squares.
    """
    for f in range(start, stop):
        c = component[f]
        sums[c, 0] += 1
        sums[c, 2] += areas[f]
        if coplanar[f] > 0:
            sums[c, 1] += 1
            sums[c, 3] += areas[f]
        for k in range(3):
            side = length(subtract(row(vertices, faces[f, k]), row(vertices, faces[f, k - 1])))
            sums[c, 4] += side
            sums[c, 5] += side * side


@kernel
def _coplanar_range(
    start: int,
    stop: int,
    vertices: Vectors,
    faces: Ints32,
    normals: Vectors,
    across: Ints32,
    limit: float,
    out: NDArray[np.int8],
) -> None:
    for f in range(start, stop):
        out[f] = 0
        for side in range(3):
            g = np.int64(across[f, side])  # as f is: a kernel is compiled for each type
            if g < 0:
                continue
            if min(_highest(vertices, faces, normals, f, g), _highest(vertices, faces, normals, g, f)) <= limit:
                out[f] += 1


@kernel
def _highest(vertices: Vectors, faces: Ints32, normals: Vectors, f: Index, g: Index) -> float:
    """Largest distance of a vertex of face g from the plane of face f."""
    most = 0.0
    for k in range(3):
        height = 0.0
        for d in range(3):
            height += (vertices[faces[g, k], d] - vertices[faces[f, 0], d]) * normals[f, d]
        most = max(most, abs(height))
    return most
