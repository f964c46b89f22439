"""Normals of quadrics that are fitted to the faces around a face."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.geometry.neighborhoods import faces_near
from cascadenorm.mesh import Mesh, Vectors, unit

FIT_RADIUS, SPREAD = 5.0, 2.2
"""Radius of the neighbourhood and standard deviation of the weights, in mean edge lengths."""
LEAST_COSINE = 0.5
"""Least cosine between the normals of a face and its neighbours that take part."""
FEWEST_NEIGHBORS = 12
"""Faces with fewer neighbours keep their normal; a quadric has six coefficients."""
DAMPING = 1e-3
"""Weight that keeps the curvature of a quadric finite where the neighbours lie on few lines."""
AT_ONCE = 4096
"""Number of quadrics that are fitted together; each takes about 10 kB."""


def quadric_normals(mesh: Mesh, normals: Vectors, faces: NDArray[np.intp]) -> Vectors:
    """Fit a quadric to the centroids around each of k faces, and return its normal at the centroid, (k, 3).

    The quadric is z = a + bu + cv + du² + euv + fv² in a frame whose z axis is the given normal of the face, a row of
    `normals`, (m, 3). Neighbours are weighted by area and by a Gaussian of the distance.
    """
    parts = [faces[start : start + AT_ONCE] for start in range(0, len(faces), AT_ONCE)]
    return np.concatenate([np.empty((0, 3)), *(_quadric_normals(mesh, normals, part) for part in parts)])


def _quadric_normals(mesh: Mesh, normals: Vectors, faces: NDArray[np.intp]) -> Vectors:
    near = faces_near(mesh, faces.astype(np.int32), FIT_RADIUS * mesh.mean_edge_length)
    own, others, starts = np.repeat(np.arange(len(faces)), near.counts), near.indices, near.indptr[:-1]
    z = normals[faces]
    x = unit(np.cross(z, np.eye(3)[np.abs(z).argmin(axis=1)]))
    frames = np.stack([x, np.cross(z, x), z], axis=1)
    offsets = (mesh.centroids[others] - mesh.centroids[faces][own]) / mesh.mean_edge_length
    u, v, w = np.einsum("nij,nj->in", frames[own], offsets)
    similar = np.einsum("ij,ij->i", normals[others], z[own]) > LEAST_COSINE
    weights = mesh.areas[others] * np.exp(-0.5 * (u * u + v * v + w * w) / SPREAD**2) * similar
    weights /= np.maximum(np.add.reduceat(weights, starts), np.finfo(float).tiny)[own]
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    weighted = weights[:, None] * terms
    system = np.add.reduceat(weighted[:, :, None] * terms[:, None, :], starts)
    system += DAMPING * np.diag([0, 0, 0, 1, 1, 1]) + 1e-9 * np.eye(6)
    _, b, c, *_ = np.linalg.solve(system, np.add.reduceat(weighted * w[:, None], starts)[..., None])[..., 0].T
    fitted = unit(z - b[:, None] * frames[:, 0] - c[:, None] * frames[:, 1])
    enough = np.add.reduceat(similar.astype(np.intp), starts) >= FEWEST_NEIGHBORS
    return np.where(enough[:, None], fitted, z)
