"""Replace the triangles of a surface, as programs do before they export scans."""

import numpy as np
from scipy.spatial import cKDTree

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.decimate import thinned
from cascadenorm.data_gen.meshing.half_edges import half_edges_of, is_manifold, mesh_of
from cascadenorm.data_gen.meshing.remesh import SHORT, collapse_short, flip_edges, mend, slide, split_long
from cascadenorm.data_gen.meshing.surface import fit
from cascadenorm.mesh import Mesh, Vectors


def resampled(mesh: Mesh, *, faces: int, rng: np.random.Generator) -> Mesh:
    """Return a mesh with about `faces` other triangles: decimated, or nearly equilateral (Botsch and Kobbelt 2004).

    Raises UnfitShapeError if one of the meshes is invalid.
    """
    if rng.random() < 0.5:
        return thinned(mesh, faces=faces, evenness=float(10 ** rng.uniform(-7, -2)))
    if not is_manifold(mesh):
        raise UnfitShapeError("the mesh is not manifold")
    half_edges = half_edges_of(mesh)
    half_edges.length[:] = np.sqrt(4 / np.sqrt(3) * mesh.area / faces)
    near = cKDTree(mesh.centroids)
    for _ in range(rng.integers(2, 6)):
        split_long(half_edges)
        collapse_short(half_edges, SHORT)
        flip_edges(half_edges, rule="valence")
        slide(half_edges, 0.6)
        half_edges.points[:] = _onto(mesh, near, half_edges.points)
    mend(half_edges)
    return fit(mesh_of(half_edges))


def _onto(mesh: Mesh, near: cKDTree, points: Vectors) -> Vectors:
    """Project points, (n, 3), onto the planes of the faces of a mesh with the nearest centroids."""
    face = near.query(points)[1]
    normals = mesh.face_normals[face]
    heights: Vectors = np.einsum("ij,ij->i", points - mesh.centroids[face], normals)[:, None] * normals
    return points - heights
