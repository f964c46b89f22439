"""Detection of the steps of binary masks whose voxel size is unknown."""

import numpy as np

from cascadenorm.detection.voxel_lattice import lattice_share
from cascadenorm.mesh import (
    Bools,
    Floats,
    Ints,
    Ints32,
    Mesh,
    Vectors,
    angles_between,
    any_in_rows,
    kernel,
    part_of,
    row_distances,
    scatter_add,
)
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
    """Return whether most faces of a mesh are voxel faces (see `voxel_components`)."""
    return bool(voxel_components(mesh)[mesh.topology.face_components].mean() > 0.5)


def voxel_components(mesh: Mesh) -> Bools:
    """Return the components, (c,), that consist of the voxel faces of a segmentation (cuberille; Herman, Liu 1979).

    Those whose faces lie along three axes are examined together, since small ones alone have too few edges.
    """
    components = mesh.topology.face_components
    first = _largest_normals(mesh, np.zeros((mesh.topology.component_count, 3)))
    second = _largest_normals(mesh, first)
    axes = np.stack([first, second, np.cross(first, second)], axis=1)
    total, sums = np.zeros(len(axes)), np.zeros(len(axes))
    _add_areas(components, mesh.areas, mesh.face_normals, axes, total, sums)
    along = (sums >= ALONG_AXES * total) & second.any(axis=1)
    faces = along[components]
    if not faces.any() or not is_segmentation(mesh if faces.all() else part_of(mesh, faces)[0]):
        return np.zeros_like(along)
    return along


def without_voxel_faces(mesh: Mesh) -> Mesh:
    """Move the vertices of components of voxel faces to the mean of the centroids around them."""
    voxels = voxel_components(mesh)
    if not voxels.any():
        return mesh
    means = averaged_around(mesh.centroids, mesh.topology.vertex_faces)
    return mesh.moved(np.where(voxels[mesh.topology.components][:, None], means, mesh.vertices))


def _largest_normals(mesh: Mesh, across: Vectors) -> Vectors:
    """Return the normal of the largest face of each component whose normal is perpendicular to its vector, (c, 3).

    A component without such a face has a zero row.
    """
    found, most = np.full(len(across), -1), np.zeros(len(across))
    _find_largest(mesh.topology.face_components, mesh.areas, mesh.face_normals, across, found, most)
    return np.where((found >= 0)[:, None], mesh.face_normals[found], 0.0)


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
def _find_largest(
    components: Ints32, areas: Floats, normals: Vectors, across: Vectors, found: Ints, most: Floats
) -> None:
    """Find the largest face of each of c components whose normal is perpendicular to its vector, and its area."""
    for f in range(len(areas)):
        c = components[f]
        if areas[f] > most[c] and abs(dot(row(normals, f), row(across, c))) < 1e-3:
            found[c], most[c] = f, areas[f]


@kernel
def _add_areas(components: Ints32, areas: Floats, normals: Vectors, axes: Floats, total: Floats, along: Floats) -> None:
    """Add the areas of the faces of each component, and of those with a normal along one of its three axes."""
    for f in range(len(areas)):
        c = components[f]
        total[c] += areas[f]
        for axis in range(3):
            if abs(dot(row(normals, f), row(axes[c], axis))) > 1 - 1e-4:
                along[c] += areas[f]
                break
