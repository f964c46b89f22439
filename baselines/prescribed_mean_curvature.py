"""Flow to a surface of prescribed mean curvature, that of the input after smoothing (Hildebrandt & Polthier 2004)."""

import math
from typing import Annotated

import numpy as np

from cascadenorm.baselines.anisotropic_diffusion import Presmoothing, anisotropic_laplacian, diffused_vertex_normals
from cascadenorm.baselines.diffusion import DiffusionStep, Moving, component_means, diffuse, implicit_moves
from cascadenorm.execution.progress import track
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.mesh import Floats, Mesh, Vectors, scatter_add, unit
from cascadenorm.registry import Parameter, method

SMOOTHINGS = 5  # implicit steps that the diffusion of the curvature is made of
SHARPNESS = 10.0  # r of the paper's edge weight: how fast it falls past the crease threshold


@method("prescribed-mean-curvature", source="Hildebrandt, Polthier 2004", family="smoothing")
def prescribed_mean_curvature(
    mesh: Mesh,
    *,
    smoothing: Annotated[
        float, Parameter("Diffusion time of the mean curvature", "squared mean edge lengths", minimum=0, below=math.inf)
    ] = 2.0,
    threshold: Annotated[
        float,
        Parameter(
            "Change of the smoothed normals above which a vertex belongs to a crease",
            "radians per mean edge length",
            minimum=1e-6,
        ),
    ] = 0.15,
    presmoothing: Presmoothing = 1.0,
    step: DiffusionStep = 0.5,
    iterations: Annotated[int, Parameter("Number of semi-implicit steps", minimum=0)] = 5,
    region: Moving = None,
) -> Vectors:
    """Move the vertices until the mean curvature is the smoothed one of the input: a cylinder keeps its radius.

    The flow is M x_t = M f n - A: A is the gradient of the area, in which the creases of the input have less weight and
    boundaries do not pull inward. f is the normal component of A on the input, smoothed by `anisotropic_laplacian`.
    Steps are preconditioned by (M + tS)⁻¹ and at most as long as a mean edge, and no component drifts as a whole.
    Vertices outside the region and those without a face do not move.

    Formula
    -------
    M x_t = M f n - ½ Σ_e w_e H_e N_e,   H_e N_e = (n_2 - n_1) × e
    f: mean curvature of the input with weights w, smoothed anisotropically
    w = 1 / (10 (c/threshold - 1)² + 1) past the threshold, of the turn c of the normals; 1 before it

    Limits
    ------
    It suits light noise only, because creases are found in the noisy mesh. Its parameters depend on the noise more than
    those of normal filters do.
    """
    edge = mesh.mean_edge_length
    unit_time = edge**2
    time = step * unit_time
    normals = diffused_vertex_normals(mesh, presmoothing)
    weights = crease_weights(mesh, normals, threshold=threshold)
    smoother = anisotropic_laplacian(mesh, normals, threshold=threshold)
    curvature = smoother.inverse_mass * (area_gradient(mesh, weights) * normals).sum(axis=1)
    target = diffuse(smoother, curvature[:, None], time=smoothing / SMOOTHINGS * unit_time, iterations=SMOOTHINGS)
    for _ in track(iterations):
        laplacian = cotangent_laplacian(mesh)
        normals = diffused_vertex_normals(mesh, presmoothing)
        velocity = target * normals - laplacian.inverse_mass[:, None] * area_gradient(mesh, weights)
        velocity -= component_means(mesh.topology.components, laplacian.mass, velocity, region)
        if region is not None:
            velocity[~region] = 0
        moves = implicit_moves(mesh, laplacian, velocity, time=time, region=region)
        lengths = np.linalg.norm(moves, axis=1, keepdims=True)
        mesh = mesh.moved(mesh.vertices + moves * np.minimum(1, edge / np.maximum(lengths, 1e-300)))
    return mesh.vertices.copy()


def crease_weights(mesh: Mesh, normals: Vectors, *, threshold: float) -> Floats:
    """Return the (e,) weight of each edge: 1 where the surface turns little, less at creases, 0 unless it is interior.

    The turn c is that of the given vertex normals from the middle of one face of the edge to that of the other; past
    the threshold the weight is threshold² / (10 (c - threshold)² + threshold²).
    """
    first, second = mesh.topology.face_pairs.T
    middle = unit(normals[mesh.faces].sum(axis=1))
    past = np.maximum(np.linalg.norm(middle[second] - middle[first], axis=1) / threshold - 1, 0)
    weights = np.zeros(len(mesh.topology.edges))
    weights[mesh.topology.interior_edges] = 1 / (SHARPNESS * past**2 + 1)
    return weights


def area_gradient(mesh: Mesh, weights: Floats) -> Vectors:
    """Return (n, 3) sums ½ Σ w_e H_e N_e over the edges e of each vertex; with weights 1, the gradient of the area."""
    edges, face_edges = mesh.topology.edges, mesh.topology.face_edges
    corners = mesh.corners
    sides = np.roll(corners, -1, axis=1) - corners
    inward = np.cross(mesh.face_normals[:, None], sides).reshape(-1, 3)  # vectors in the face, as long as the side
    pulls = -0.5 * (weights[:, None] * scatter_add(face_edges.ravel(), inward, len(edges)))
    return scatter_add(edges.ravel(), np.repeat(pulls, 2, axis=0), len(mesh.vertices))
