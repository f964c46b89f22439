"""Filter measured surfaces after the cascade, and fit quadrics at their boundaries."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from cascadenorm.baselines.bilateral_normal import bilateral_normal, bilateral_normals
from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.geometry.neighborhoods import faces_near
from cascadenorm.geometry.patches.work import normals_by_patches
from cascadenorm.learned.features import component_means, component_sums, openness
from cascadenorm.learned.noise_evidence import turning_angles
from cascadenorm.mesh import Bools, Mesh, Vectors, unit, with_part_moved

SIGMA_S, SIGMA_R, SWEEPS = 0.5, 0.45, 8
"""Settings of the bilateral filter of the result, named as in the method `bilateral-normal`."""
SCAN_PASSES, SCAN_SHARE = 3, 0.6
"""Passes of `bilateral-normal` over the input of sheets with little noise, and the share of its normals."""
LITTLE_TURNED = np.radians(8.0)
"""Mean angle by which the network turns the faces of a component, below which the component has little noise."""
HARDLY_TURNED = np.radians((3.0, 5.0))
"""Mean angles by which the network turns a component, between which the effect of the filter rises to its full size."""
LEAST_OPENNESS = 0.4  # smallest openness of a component seen from one side; a hemisphere has 0.5 (see `openness`)
QUADRIC_SHARES = 0.7, 0.3
"""Shares of the normals of fitted quadrics: at faces on the boundary, and at the faces next to them."""
FIT_RADIUS, SPREAD = 5.0, 2.2
"""Radius of the neighbourhood of a quadric and standard deviation of the weights in it, in mean edge lengths."""
LEAST_COSINE = 0.5  # least cosine between the normals of a face and its neighbours that take part in its quadric
FEWEST_NEIGHBORS = 12  # faces with fewer neighbours keep their normal; a quadric has six coefficients
DAMPING = 1e-3  # weight that keeps the curvature of a quadric finite where the neighbours lie on few lines
AT_ONCE = 4096  # number of quadrics that are fitted together; each takes about 10 kB


def with_filtered_surfaces(mesh: Mesh, vertices: Vectors, measured: Bools) -> Vectors:
    """Return vertices, (n, 3), after a bilateral filter of the measured surfaces, (m,) faces of whole components.

    `mesh` is the input mesh, and `vertices`, (n, 3), are those after the cascade. The network leaves some noise on
    measured surfaces, since its training data contain detail of the same size. One pass over its result removes most of
    it. On sheets with little noise, such as those from laser scanners, such a pass would remove detail. There, the
    normals of the result are averaged with those of the input after `bilateral-normal`, whose errors differ from those
    of the network. The errors of scanners are larger at the boundary of a view. The normals there are also averaged
    with those of fitted quadrics, because a filter alone would flatten the surface, which often curves away. Components
    that the network hardly turns are not filtered.
    """
    if not measured.any():
        return vertices
    denoised, components = mesh.moved(vertices), mesh.topology.face_components
    sums = component_sums(turning_angles(mesh, denoised.face_normals)[:, None], mesh)
    turned = component_means(sums)[:, 0]
    measured = measured & (turned > HARDLY_TURNED[0])[components]
    sheets = measured & ((openness(sums) > LEAST_OPENNESS) & (turned < LITTLE_TURNED))[components]
    filtered = with_part_moved(denoised, measured & ~sheets, _filtered)
    filtered = with_part_moved(denoised.moved(filtered), sheets, _averaged, mesh.vertices)
    shares = np.zeros(len(vertices))
    shares[mesh.faces.ravel()] = np.repeat(np.interp(turned, HARDLY_TURNED, (0, 1))[components], 3)
    return vertices + shares[:, None] * (filtered - vertices)


def _filtered(mesh: Mesh) -> Vectors:
    """Return the vertices, (n, 3), after one pass over the result of the network."""
    one_pass = partial(bilateral_normals, sigma_s=SIGMA_S, sigma_r=SIGMA_R, iterations=1)
    return _recovered(mesh, normals_by_patches(mesh, one_pass, receptive_field=1))


def _averaged(mesh: Mesh, noisy: Vectors) -> Vectors:
    """Return the vertices, (n, 3), for the mean of the normals of the network and of the filtered input, (n, 3)."""
    filtered = mesh.moved(bilateral_normal(mesh.moved(noisy), iterations=SCAN_PASSES))
    return _recovered(mesh, unit((1 - SCAN_SHARE) * mesh.face_normals + SCAN_SHARE * filtered.face_normals))


def _recovered(mesh: Mesh, normals: Vectors) -> Vectors:
    """Return the vertices, (n, 3), for normals that are averaged with those of quadrics at the boundary."""
    boundary = mesh.topology.boundary_vertices
    if boundary.any():
        at = boundary[mesh.faces].any(axis=1)
        around = np.isin(mesh.faces, mesh.faces[at]).any(axis=1)
        given, normals = normals, normals.copy()
        for share, chosen in zip(QUADRIC_SHARES, (at, around & ~at), strict=True):
            faces = np.flatnonzero(chosen)
            normals[faces] = unit((1 - share) * given[faces] + share * quadric_normals(mesh, given, faces))
    return recover_vertices(mesh, normals, sweeps=SWEEPS)


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
