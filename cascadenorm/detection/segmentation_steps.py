"""Detection of the steps of binary masks whose voxel size is unknown."""

import numpy as np

from cascadenorm.detection.voxel_lattice import lattice_share
from cascadenorm.mesh import Floats, Mesh, Vectors, angles_between, any_in_rows, kernel, row_distances, scatter_add
from cascadenorm.mesh.averages import averaged, averaged_around
from cascadenorm.mesh.vectors import dot, row

LATTICE = 0.5  # smallest `lattice_share` on a lattice; marching cubes give 0.95, surface nets less
CANCELLING_SHARE = 0.2  # smallest share of bends that cancel within two rings; a step has a convex and a concave edge
IN_PLANES = 0.03  # smallest fraction of vertices with coplanar faces, as on treads; CAD kernels create none
ALL_STEPS = 0.65  # share of cancelling bends above which IN_PLANES is not required, since decimation may be the cause
ALONG_AXES = 0.98  # smallest fraction of the area with normals along three perpendicular directions
COPLANAR = 3e-6
"""Height above the plane of the adjacent triangle, in diagonals, up to which a vertex is coplanar.

Rounding to single precision stays within a tenth of it; noise of measured surfaces almost always exceeds it."""
SMALL_HEIGHT = 1e-3  # upper limit of this height in median edge lengths, for meshes with distant vertices


def is_segmentation(mesh: Mesh) -> bool:
    """Return whether edges repeat few vectors, bends alternate in sign, and vertices lie within planes, as on steps."""
    if lattice_share(mesh) < LATTICE:
        return False
    steps = _step_share(mesh)
    return steps >= ALL_STEPS or (steps >= CANCELLING_SHARE and _share_in_planes(mesh) >= IN_PLANES)


def has_voxel_faces(mesh: Mesh) -> bool:
    """Return whether a mesh consists of the voxel faces of a segmentation (cuberille; Herman, Liu 1979)."""
    first = _normal_of_largest(mesh, np.zeros(3))
    second = None if first is None else _normal_of_largest(mesh, first)
    if first is None or second is None:
        return False
    axes = np.stack([first, second, np.cross(first, second)])
    return bool(_share_along(mesh.areas, mesh.face_normals, axes) >= ALONG_AXES) and is_segmentation(mesh)


def without_voxel_faces(mesh: Mesh) -> Mesh:
    """Move vertices of a mesh of voxel faces to the mean of the centroids around them; return others unchanged."""
    if not has_voxel_faces(mesh):
        return mesh
    means = averaged_around(mesh.centroids, mesh.topology.vertex_faces)
    return mesh.moved(np.where(mesh.topology.used_vertices[:, None], means, mesh.vertices))


def _normal_of_largest(mesh: Mesh, across: Vectors) -> Vectors | None:
    """Return the normal of the largest face whose normal is perpendicular to a vector, or None."""
    one = _largest(mesh.areas, mesh.face_normals, across)
    return mesh.face_normals[one] if one >= 0 else None


def _step_share(mesh: Mesh) -> float:
    """Return the share of the bends, edge lengths times dihedral angles, that cancel within two rings.

    It is 0 for a flat mesh. Edges at a face without a normal are ignored.
    """
    topology = mesh.topology
    has_area = any_in_rows(mesh.face_normals != 0)
    bends = has_area[topology.face_pairs].all(axis=1)
    pairs, ends = topology.face_pairs[bends], topology.edges[topology.interior_edges[bends]]
    first, second = mesh.face_normals[pairs.T]
    between = mesh.centroids[pairs[:, 1]] - mesh.centroids[pairs[:, 0]]
    # heights of the two centroids above each other's planes, summed; below 0 at convex edges
    rise = np.einsum("ij,ij->i", between, first - second)
    length, angle = row_distances(mesh.vertices, ends), angles_between(first, second)
    rounding = min(COPLANAR * mesh.diagonal, SMALL_HEIGHT * mesh.median_edge_length)
    bend = length * angle * (np.abs(rise) > rounding)
    signed = np.stack([np.copysign(bend, rise), bend], axis=1)
    at_vertices = scatter_add(ends.ravel(), np.repeat(signed, 2, axis=0), len(mesh.vertices))
    left, total = np.abs(averaged(at_vertices, topology.vertex_neighbors, 2)).T
    return float(1 - left.sum() / total.sum()) if total.any() else 0.0


def _share_in_planes(mesh: Mesh) -> float:
    """Return the fraction of the used vertices whose faces are coplanar within 0.03 degrees."""
    least = np.ones(len(mesh.vertices))
    cosines = np.einsum("ijk,ik->ij", mesh.vertex_normals[mesh.faces], mesh.face_normals)
    np.minimum.at(least, mesh.faces, cosines)
    return float(np.mean(least[mesh.topology.used_vertices] > 1 - 1e-7))


@kernel
def _largest(areas: Floats, normals: Vectors, across: Vectors) -> int:
    """Return the index of the largest face whose normal is perpendicular to a vector, or -1."""
    found, most = -1, 0.0
    for f in range(len(areas)):
        if areas[f] > most and abs(dot(row(normals, f), across)) < 1e-3:
            found, most = f, areas[f]
    return found


@kernel
def _share_along(areas: Floats, normals: Vectors, axes: Vectors) -> float:
    """Return the share of the area, which is above 0, that belongs to faces with a normal along an axis."""
    total = along = 0.0
    for f in range(len(areas)):
        total += areas[f]
        for axis in range(3):
            if abs(dot(row(normals, f), axes[axis])) > 1 - 1e-4:
                along += areas[f]
                break
    return along / total
