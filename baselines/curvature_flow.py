"""Mean curvature flow: diffusion whose Laplacian follows the surface (Desbrun et al. 1999)."""

from typing import Annotated

from cascadenorm.baselines.diffusion import DiffusionStep, Moving, Scheme, flowed
from cascadenorm.execution.progress import track
from cascadenorm.geometry.laplacians import MOLLIFICATION, cotangent_laplacian
from cascadenorm.mesh import Mesh, Vectors
from cascadenorm.registry import Parameter, method


@method("mean-curvature-flow", source="Desbrun, Meyer, Schröder, Barr 1999", family="smoothing")
def mean_curvature_flow(
    mesh: Mesh,
    *,
    scheme: Annotated[Scheme, Parameter("Type of steps; implicit ones are stable at any size")] = "implicit",
    step: DiffusionStep = 0.25,
    iterations: Annotated[int, Parameter("Number of steps, each with a new Laplacian", minimum=0)] = 3,
    region: Moving = None,
) -> Vectors:
    """Move the vertices by λΔx = -2λHn, with the cotangent Laplacian rebuilt before every step.

    A sphere of radius r0 has r(t)² = r0² - 4λt. Explicit steps that are too long are cut as in `diffuse`. A boundary
    moves off the surface only (see `flowed`). Vertices outside the region, and those without a face, stay.

    Formula
    -------
    x_t = λΔx = -2λHn;   implicit: (M + tS) x ← M x,   M masses, S stiffness of cotangents, both of the moving mesh

    Limits
    ------
    It shrinks the mesh and rounds every edge. Thin necks pinch off.
    """
    edge = mesh.mean_edge_length
    for _ in track(iterations):
        slack = MOLLIFICATION * edge / (mesh.mean_edge_length or 1.0)  # a part that has shrunk to a point stays one
        laplacian = cotangent_laplacian(mesh, mollification=slack)
        mesh = mesh.moved(flowed(mesh, laplacian, time=step * edge**2, scheme=scheme, region=region))
    return mesh.vertices.copy()
