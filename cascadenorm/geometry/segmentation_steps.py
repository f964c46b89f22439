"""Steps of a binary mask, told from the shape of a mesh where its voxels are not known any more."""

import numpy as np

from cascadenorm.geometry.averages import averaged
from cascadenorm.geometry.rounding import rounding
from cascadenorm.geometry.voxel_lattice import lattice_share
from cascadenorm.mesh import Mesh, angles_between, scatter_add

LATTICE = 0.5
"""Share of the edges that the most frequent vectors hold (see `lattice_share`), from which a mesh lies on a lattice.

Decimated meshes and surface nets have fewer than those of marching cubes, which have 0.95."""
STEPS = 0.2
"""Share of the bends that cancel within two rings, from which a mesh has steps: a step has an edge of either sign."""
IN_PLANES = 0.03
"""Share of the vertices whose faces all lie in one plane, as on the treads of steps; CAD kernels make none."""
ALL_STEPS = 0.65
"""The share of bends from which the vertices do not matter, which a decimation may have removed from the planes."""
ALONG_AXES = 0.98
"""Share of the area whose normals lie along three perpendicular directions, from which faces are those of voxels."""


def is_segmentation(mesh: Mesh) -> bool:
    """Whether the edges are few vectors repeated and bend to and fro, and vertices lie inside of planes."""
    if lattice_share(mesh) < LATTICE:
        return False
    steps = _share_of_steps(mesh)
    return steps >= ALL_STEPS or (steps >= STEPS and _share_in_planes(mesh) >= IN_PLANES)


def has_voxel_faces(mesh: Mesh) -> bool:
    """Whether a mesh consists of the faces of the voxels of a segmentation (cuberille; Herman, Liu 1979)."""
    if not mesh.area > 0:
        return False
    first = mesh.normals[np.argmax(mesh.areas)]
    across = np.abs(mesh.normals @ first) < 1e-3
    if not (across & (mesh.areas > 0)).any():
        return False
    second = mesh.normals[np.argmax(mesh.areas * across)]
    axes = np.stack([first, second, np.cross(first, second)])
    along = np.abs(mesh.normals @ axes.T).max(axis=1) > 1 - 1e-4
    return bool(mesh.areas[along].sum() >= ALONG_AXES * mesh.area) and is_segmentation(mesh)


def without_voxel_faces(mesh: Mesh) -> Mesh:
    """Move each vertex of a mesh of voxel faces to the mean of the centroids around it; any other stays as it is.

    The normals of voxel faces have three directions, whatever the shape; after one average they tell where it leads.
    """
    if not has_voxel_faces(mesh):
        return mesh
    around = mesh.topology.vertex_faces
    sums = scatter_add(mesh.faces.ravel(), np.repeat(mesh.centroids, 3, axis=0), len(mesh.vertices))
    used = mesh.topology.used_vertices[:, None]
    return mesh.moved(np.where(used, sums / np.maximum(around.counts, 1)[:, None], mesh.vertices))


def _share_in_planes(mesh: Mesh) -> float:
    """Share of the vertices with faces whose faces all lie in one plane, to a fiftieth of a degree."""
    least = np.ones(len(mesh.vertices))
    cosines = np.einsum("ijk,ik->ij", mesh.vertex_normals[mesh.faces], mesh.normals)
    np.minimum.at(least, mesh.faces, cosines)
    return float((least[mesh.topology.used_vertices] > 1 - 1e-7).mean())


def _share_of_steps(mesh: Mesh) -> float:
    """Share of the bends, angles times lengths of edges, that those of the other sign cancel within two rings."""
    topology = mesh.topology
    first, second = topology.face_pairs.T
    across = mesh.centroids[second] - mesh.centroids[first]
    rise = np.einsum("ij,ij->i", across, mesh.normals[first] - mesh.normals[second])
    ends = topology.edges[topology.interior_edges]
    length = np.linalg.norm(mesh.vertices[ends[:, 1]] - mesh.vertices[ends[:, 0]], axis=1)
    bend = length * angles_between(mesh.normals[first], mesh.normals[second]) * (np.abs(rise) > rounding(mesh))
    signed = np.stack([np.copysign(bend, rise), bend], axis=1)
    at_vertices = scatter_add(ends.ravel(), np.repeat(signed, 2, axis=0), len(mesh.vertices))
    left, total = np.abs(averaged(at_vertices, topology.vertex_neighbors, 2)).T
    return float(1 - left.sum() / max(total.sum(), np.finfo(float).tiny))
