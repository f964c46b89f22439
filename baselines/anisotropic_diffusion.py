"""Anisotropic geometric diffusion: strong along creases, weak across them (Clarenz et al. 2000; Bajaj & Xu 2003)."""

import math
from typing import Annotated

import numpy as np

from cascadenorm.baselines.diffusion import DiffusionStep, Moving, diffuse, flowed
from cascadenorm.execution.progress import track
from cascadenorm.geometry.laplacians import Laplacian, assemble, cotangent_laplacian, intrinsic_lengths, vertex_masses
from cascadenorm.mesh import Floats, Mesh, Vectors, scatter_add, unit
from cascadenorm.registry import Parameter, method

CurvatureThreshold = Annotated[
    float, Parameter("Curvature at which the diffusion is halved", "radians per mean edge length", minimum=1e-6)
]
Presmoothing = Annotated[
    float,
    Parameter(
        "Diffusion time of the normals from which the curvature is computed",
        "squared mean edge lengths",
        minimum=0,
        below=math.inf,
    ),
]


@method("anisotropic-diffusion", source="Clarenz, Diewald, Rumpf 2000; Bajaj, Xu 2003", family="smoothing")
def anisotropic_diffusion(
    mesh: Mesh,
    *,
    threshold: CurvatureThreshold = 0.2,
    presmoothing: Presmoothing = 1.0,
    step: DiffusionStep = 0.3,
    iterations: Annotated[int, Parameter("Number of implicit steps, each with a new diffusion tensor", minimum=0)] = 5,
    region: Moving = None,
) -> Vectors:
    """Diffuse the vertices along creases but little across them, by a tensor that follows the curvature.

    Boundary vertices move perpendicular to the surface only (see `flowed`).

    Formula
    -------
    x_t = div(a ∇x),   a = Σ_i g(κ_i) d_i d_iᵀ,   g(κ) = 1 / (1 + (κ l_e / threshold)²)
    κ_i, d_i: principal curvatures and directions of the diffused normals, in each face

    Limits
    ------
    Curved edges become shorter, and corners are rounded. Noise whose curvature exceeds the threshold is kept like a
    feature.
    """
    time = step * mesh.mean_edge_length**2
    for _ in track(iterations):
        normals = diffused_vertex_normals(mesh, presmoothing)
        laplacian = anisotropic_laplacian(mesh, normals, threshold=threshold)
        mesh = mesh.moved(flowed(mesh, laplacian, time=time, region=region))
    return mesh.vertices.copy()


def diffused_vertex_normals(mesh: Mesh, presmoothing: float) -> Vectors:
    """Return (n, 3) unit vertex normals, diffused for a time in squared mean edge lengths; zero without a face."""
    time = presmoothing * mesh.mean_edge_length**2
    return unit(diffuse(cotangent_laplacian(mesh), mesh.vertex_normals, time=time, iterations=1))


def anisotropic_laplacian(mesh: Mesh, normals: Vectors, *, threshold: float) -> Laplacian:
    """Return div(a grad) with a = Σ g(κ_i) d_i d_iᵀ in each face, and g(κ) = 1 / (1 + (κ l_e / threshold)²).

    Curvatures κ_i and directions d_i are those of the linear interpolation of the normals, (n, 3) unit vectors, over
    the face. The threshold is in radians per mean edge length l_e. The stiffness is positive semidefinite; as the
    threshold goes to infinity it becomes the cotangent Laplacian. Degenerate faces are mollified.
    """
    lengths = intrinsic_lengths(mesh)
    weights, areas = _tensor_weights(mesh, lengths, normals, (mesh.mean_edge_length or 1.0) / threshold)
    edge_weights = scatter_add(mesh.topology.face_edges.ravel(), weights.ravel(), len(mesh.topology.edges))
    return assemble(mesh, edge_weights, vertex_masses(mesh, areas))


@np.errstate(all="ignore")  # faces of extreme shapes
def _tensor_weights(mesh: Mesh, lengths: Floats, normals: Vectors, scale: float) -> tuple[Floats, Floats]:
    """Return the weight of each side, (m, 3), -A ∇φ_k·a ∇φ_(k+1), and the area of each face, (m,).

    They are those in the plane of a face with the given lengths of its sides, (m, 3).
    """
    l0, l1, l2 = lengths.T
    x = (l0 * l0 + l2 * l2 - l1 * l1) / (2.0 * l0)
    y = np.sqrt(np.maximum(l2 * l2 - x * x, 0.0))
    double = l0 * y  # corners at (0, 0), (l0, 0), (x, y)
    ax, ay = np.stack([-y, y, np.zeros_like(y)]) / double, np.stack([x - l0, -x, l0]) / double  # gradients ∇φ_k
    bx, by = np.roll(ax, -1, axis=0), np.roll(ay, -1, axis=0)

    # symmetrised shape operator of the interpolated normals, determined by its effect along each side
    at, places = normals[mesh.faces.T], mesh.vertices[mesh.faces.T]
    along = np.roll(places, -1, axis=0) - places
    turns = -0.5 * scale * np.einsum("kfd,kfd->kf", np.roll(at, -1, axis=0) - at, along)
    p = (2.0 * turns * ax * bx).sum(axis=0)
    q = (turns * (ax * by + ay * bx)).sum(axis=0)
    r = (2.0 * turns * ay * by).sum(axis=0)

    # a = Σ 1/(1 + κ²) d dᵀ = (1 + W²)⁻¹, without eigenvectors
    u, v, w = 1.0 + p * p + q * q, q * (p + r), 1.0 + q * q + r * r
    flow = (w * ax * bx - v * (ax * by + ay * bx) + u * ay * by) / (u * w - v * v)
    return (-0.5 * double * flow).T, 0.5 * double
