"""A method of one's own: replace the body of the function, its name and its parameters."""

from typing import Annotated

from cascadenorm.baselines.bilateral_normal import bilateral_normals
from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.mesh import Mesh, Vectors
from cascadenorm.registry import Parameter, method

NAME = "own-denoiser"


@method(NAME, source="mine, 2026")
def own_denoiser(mesh: Mesh, *, rounds: Annotated[int, Parameter("rounds of both steps", minimum=0)] = 3) -> Vectors:
    """Filter the face normals, move the vertices to them, and repeat."""
    for _ in range(rounds):
        normals = bilateral_normals(mesh, sigma_s=1.0, sigma_r=0.35, iterations=3)
        mesh = mesh.moved(recover_vertices(mesh, normals, sweeps=10))
    return mesh.vertices
