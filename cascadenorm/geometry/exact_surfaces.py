"""Surfaces that were computed, not measured: their triangles are coplanar with a neighbour, as CAD leaves them, or bend
evenly, as chords of a smooth surface."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.geometry.chords import Chords, chords, error_shares
from cascadenorm.geometry.rounding import rounding
from cascadenorm.geometry.segmentation_steps import is_segmentation
from cascadenorm.mesh import Floats, Index, Ints32, Mesh, Vectors, kernel, parallel_for, scatter_add

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
    counts = coplanar_neighbors(mesh)
    clean, part = counts > 0, mesh.topology.face_components
    count = int(part.max()) + 1
    faces = np.bincount(part[clean], minlength=count) / np.maximum(np.bincount(part, minlength=count), 1)
    areas = np.maximum(scatter_add(part, mesh.areas, count), np.finfo(float).tiny)
    covered = scatter_add(part[clean], mesh.areas[clean], count) / areas
    measured = measured or chords(mesh)
    unevenness = _unevenness(mesh, part, count)
    flat = (faces >= FACES) & (covered >= AREA) & ((unevenness > UNEVEN) | (covered >= EVEN_AREA))
    error = error_shares(mesh, measured, rounding(mesh), part, count)
    smooth = (error <= ERROR) & ((unevenness > UNEVEN_CURVED) | (_creased(mesh, measured, part, count) >= CREASED))
    computed = flat | smooth | ((error <= ERROR_FLAT) & (faces >= SOME))
    if computed.any() and not is_segmentation(mesh):
        exact[mesh.faces[computed[part]]] = True
    return exact


def coplanar_neighbors(mesh: Mesh) -> NDArray[np.int8]:
    """Count the neighbours across its edges with which each face lies in one plane, (m,)."""
    out = np.empty(len(mesh.faces), np.int8)
    limit = rounding(mesh)
    across = mesh.topology.faces_across
    parallel_for(len(out), _coplanar_range, mesh.vertices, mesh.faces, mesh.normals, across, limit, out)
    return out


def _creased(mesh: Mesh, measured: Chords, part: Ints32, count: int) -> Floats:
    """Share of the interior edges of each component that do not join smooth vertices, (count,)."""
    label = part[mesh.topology.face_pairs[:, 0]]
    rough = np.bincount(label[~measured.smooth], minlength=count)
    return np.asarray(rough / np.maximum(np.bincount(label, minlength=count), 1))


def _unevenness(mesh: Mesh, part: Ints32, count: int) -> Floats:
    """Coefficient of variation of the edge lengths of each component, (count,)."""
    corners = mesh.vertices[mesh.faces]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    moments = scatter_add(part, np.stack([lengths.sum(axis=1), np.square(lengths).sum(axis=1)], axis=1), count)
    mean, square = (moments / np.maximum(3 * np.bincount(part, minlength=count), 1)[:, None]).T
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0)) / np.maximum(mean, np.finfo(float).tiny))


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
