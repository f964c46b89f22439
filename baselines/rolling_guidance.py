"""Rolling guidance of face normals, which removes features narrower than a width and keeps wider ones."""

import math
from typing import Annotated

import numpy as np
import scipy

from cascadenorm.baselines.vertex_update import Sweeps, VertexFit, fit_vertices
from cascadenorm.execution.progress import track
from cascadenorm.geometry.sparse_solvers import solver_of_steps
from cascadenorm.mesh import Floats, Ints32, Mesh, Vectors, scatter_add, unit
from cascadenorm.registry import Parameter, method

WIDEST = 10.0  # mesh diagonals; wider features are removed completely, up to rounding
LEAST = 1e-6  # smallest area of a face and distance between two that are used, in mean edge lengths

Width = Annotated[
    float, Parameter("Width of the widest feature to remove", "mean edge lengths", minimum=0, below=math.inf)
]
Jump = Annotated[
    float, Parameter("σ, change of the guidance normals over this width that counts as an edge", "chord", minimum=1e-6)
]
GuidedRounds = Annotated[
    int, Parameter("Number of filters of the input normals, each guided by the previous result", minimum=0)
]


@method("rolling-guidance-normal", source="after Wang, Fu, Liu, Tong, Liu, Guo 2015", family="normals")
def rolling_guidance_normal(
    mesh: Mesh,
    *,
    width: Width = 3.0,
    sigma: Jump = 0.6,
    iterations: GuidedRounds = 4,
    sweeps: Sweeps = 60,
    fit: VertexFit = "sweeps",
) -> Vectors:
    """Remove features up to a width: filter the normals under the guidance of the last result, then fit the vertices.

    The published filter averages by Gaussian weights, over a number of faces that grows as the square of the width;
    here each average is two implicit steps of diffusion, at a cost that hardly depends on the width.

    Formula
    -------
    n ← (A + tL)⁻¹ A (A + tL)⁻¹ A n*,   L_fg = -(l/d) exp(-(width |g_f - g_g|/d)²/2σ²)
    t = (√2 - 1)(width/π)²;   g: the result of the round before
    l: length of the common edge, d: distance of the centroids across it

    Limits
    ------
    Everything narrower than the width is removed, whether it is noise or shape. Where the surface bends by over 2 σ
    within the width, all of it counts as an edge and keeps its noise: the width should be well below its radii of
    curvature and the sides of the shape.
    """
    if width == 0 or not mesh.mean_edge_length > 0:
        return mesh.vertices.copy()
    width = min(width * mesh.mean_edge_length, WIDEST * mesh.diagonal)
    normals = rolled_normals(mesh, width=width, sigma=sigma, iterations=iterations)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps, weighting="cotangent")


def rolled_normals(mesh: Mesh, *, width: float, sigma: float, iterations: int) -> Vectors:
    """Diffuse the face normals evenly, then `iterations` times again, less across edges of the previous result.

    One average is n ← (A + tL)⁻¹ A (A + tL)⁻¹ A n over the graph of faces, where A are their areas. With t = (√2 -
    1)(width/π)², it halves a half-wave as wide as `width`, which is positive and in mesh units. The weight of two faces
    in L is the length of their common edge over the distance d of their centroids across it, times exp(-(width |g_1 -
    g_2|/d)²/2σ²) with the guidance normals g. Returns (m, 3) unit normals; a face whose average vanishes keeps its
    normal.
    """
    edge = mesh.mean_edge_length
    areas = np.maximum(mesh.areas, LEAST * edge**2)
    pairs = mesh.topology.face_pairs
    lengths, distances = _dual_edges(mesh, pairs, least=LEAST * edge)
    time = (math.sqrt(2) - 1) * (width / math.pi) ** 2

    guidance = _averaged(mesh, areas, pairs, lengths / distances, time)
    for _ in track(iterations):
        slopes = np.linalg.norm(guidance[pairs[:, 0]] - guidance[pairs[:, 1]], axis=1) / distances
        weights = lengths / distances * np.exp(-0.5 * (width / sigma * slopes) ** 2)
        guidance = _averaged(mesh, areas, pairs, weights, time)
    return guidance


def _dual_edges(mesh: Mesh, pairs: Ints32, *, least: float) -> tuple[Floats, Floats]:
    """Return the length of each interior edge, (e,), and of the path between centroids via its midpoint."""
    ends = mesh.vertices[mesh.topology.edges[mesh.topology.interior_edges]]
    ways = np.linalg.norm(mesh.centroids[pairs] - ends.mean(axis=1)[:, None], axis=2).sum(axis=1)
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), np.maximum(ways, least)


def _averaged(mesh: Mesh, areas: Floats, pairs: Ints32, weights: Floats, time: float) -> Vectors:
    """Return the normals of the mesh after two implicit steps of diffusion, scaled to unit length."""
    count = len(areas)
    first, second = pairs.T
    sums = scatter_add(first, weights, count) + scatter_add(second, weights, count)
    sides = (np.concatenate([first, second]), np.concatenate([second, first]))
    graph = scipy.sparse.coo_array((np.tile(weights, 2), sides), shape=(count, count)).tocsr()
    matrix = scipy.sparse.csr_array(scipy.sparse.diags_array(areas + time * sums) - time * graph)
    solve = solver_of_steps(matrix, mesh.centroids)
    return unit(solve(areas[:, None] * solve(areas[:, None] * mesh.face_normals)), otherwise=mesh.face_normals)
