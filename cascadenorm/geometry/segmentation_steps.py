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


def is_segmentation(mesh: Mesh) -> bool:
    """Whether the edges are few vectors repeated, bend to and fro, and vertices lie inside of planes."""
    return lattice_share(mesh) >= LATTICE and _share_in_planes(mesh) >= IN_PLANES and _share_of_steps(mesh) >= STEPS


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
