"""Anisotropic geometric diffusion: strong along creases, weak across them (Clarenz et al. 2000; Bajaj & Xu 2003)."""

import math
from typing import Annotated

import numpy as np

from cascadenorm.baselines.diffusion import DiffusionStep, Moving, diffuse, flowed
from cascadenorm.execution.progress import track
from cascadenorm.geometry.laplacians import Laplacian, assemble, cotangent_laplacian, intrinsic_lengths, vertex_masses
from cascadenorm.mesh import Floats, Ints32, Mesh, Vectors, kernel, parallel_for, scatter_add, unit
from cascadenorm.registry import Parameter, method

CurvatureThreshold = Annotated[
    float, Parameter("Curvature at which the diffusion is halved", "radians per mean edge length", above=0)
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
    weights, areas = np.empty((len(mesh.faces), 3)), np.empty(len(mesh.faces))
    scale = (mesh.mean_edge_length or 1.0) / threshold
    parallel_for(len(mesh.faces), _tensor_weights, mesh.vertices, mesh.faces, lengths, normals, scale, weights, areas)
    edge_weights = scatter_add(mesh.topology.face_edges.ravel(), weights.ravel(), len(mesh.topology.edges))
    return assemble(mesh, edge_weights, vertex_masses(mesh, areas))


@kernel
def _tensor_weights(
    start: int,
    stop: int,
    vertices: Vectors,
    faces: Ints32,
    lengths: Floats,
    normals: Vectors,
    scale: float,
    weights: Floats,
    areas: Floats,
) -> None:
    """Weight of each side, -A ∇φ_k·a ∇φ_(k+1), in the plane of a face with the given lengths of its sides."""
    gradient = np.empty((3, 2))
    for f in range(start, stop):
        l0, l1, l2 = lengths[f]
        x = (l0 * l0 + l2 * l2 - l1 * l1) / (2.0 * l0)
        y = np.sqrt(max(l2 * l2 - x * x, 0.0))
        double = l0 * y  # corners at (0, 0), (l0, 0), (x, y)
        areas[f] = 0.5 * double
        gradient[0, 0], gradient[0, 1] = -y / double, (x - l0) / double
        gradient[1, 0], gradient[1, 1] = y / double, -x / double
        gradient[2, 0], gradient[2, 1] = 0.0, l0 / double
        # symmetrised shape operator of the interpolated normals, determined by its effect along each side
        p = q = r = 0.0
        for side in range(3):
            i, j = faces[f, side], faces[f, (side + 1) % 3]
            turn = -0.5 * scale * ((normals[j] - normals[i]) * (vertices[j] - vertices[i])).sum()
            a, b = gradient[side], gradient[(side + 1) % 3]
            p += 2.0 * turn * a[0] * b[0]
            q += turn * (a[0] * b[1] + a[1] * b[0])
            r += 2.0 * turn * a[1] * b[1]
        # a = Σ 1/(1 + κ²) d dᵀ = (1 + W²)⁻¹, without eigenvectors
        u, v, w = 1.0 + p * p + q * q, q * (p + r), 1.0 + q * q + r * r
        determinant = u * w - v * v
        for side in range(3):
            a, b = gradient[side], gradient[(side + 1) % 3]
            flow = (w * a[0] * b[0] - v * (a[0] * b[1] + a[1] * b[0]) + u * a[1] * b[1]) / determinant
            weights[f, side] = -areas[f] * flow
