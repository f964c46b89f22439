"""Total generalized variation of face normals, by augmented Lagrangian (after Liu, Li, Wang, Liu, Chen 2021)."""

from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy

from cascadenorm.baselines.tv_normal import LEAST_AREA_IN_EDGES, difference_operator
from cascadenorm.baselines.vertex_update import Sweeps, VertexFit, fit_vertices
from cascadenorm.execution.progress import track
from cascadenorm.geometry.sparse_solvers import MOST_ITERATIONS, conjugate_gradients
from cascadenorm.mesh import Csr, Floats, Mesh, Vectors, kernel, parallel_for, row_distances, row_lengths, unit
from cascadenorm.mesh.vectors import add, length, row, scaled
from cascadenorm.registry import Parameter, method

TOLERANCE = 1e-4  # residual of the linear systems of a round, relative to that of a zero solution
LEAST_LENGTH = 1e-3  # in mean edge lengths; shorter edges and lines count as this long, so that systems are definite

TgvFidelity = Annotated[
    float,
    Parameter(
        "α, weight of fidelity to the input normals relative to variation",
        "1 / mean edge length",
        minimum=1e-6,
        maximum=1e6,
    ),
]
SecondOrder = Annotated[float, Parameter("β, weight of second-order relative to first-order variation", minimum=0)]
TgvRounds = Annotated[int, Parameter("Number of iterations of the augmented Lagrangian", minimum=0)]


@method("tgv-normal", source="after Liu, Li, Wang, Liu, Chen 2021", family="sparsity")
def tgv_normal(
    mesh: Mesh,
    *,
    fidelity: TgvFidelity = 0.75,
    second_order: SecondOrder = 0.4,
    rounds: TgvRounds = 40,
    sweeps: Sweeps = 20,
    fit: VertexFit = "sweeps",
) -> Vectors:
    """Find unit normals near the given ones that vary little or evenly, but may jump, then fit the vertices to them.

    Formula
    -------
    minimise Σ_e w_e l_e |(D n - v)_e| + β Σ_c l_c |(E v)_c| + α Σ_f A_f |n_f - n*_f|²,   |n_f| = 1
    over the normals n and jumps v, a vector at each edge;   (D n)_e = n_1 - n_2,   w_e = exp(-|n_1 - n_2|⁴)
    (E v)_c: sum of the jumps at both sides of a corner c, out of its face;   l_c: from the corner to the centroid

    The weights are those of `tv-normal`, computed again in each round. Each round solves for n without the constraint
    and normalises, as published; the dynamic weights, the vertex update and the parameters are not from the paper.

    Limits
    ------
    E compares a face with pairs of its neighbours. On irregular triangles, the normals of a smoothly curved surface do
    not change evenly from face to face, so that curvature has a small cost as well. The problem is not convex.
    """
    normals = mesh.face_normals
    if rounds and len(mesh.topology.face_pairs):
        normals = least_variation(mesh, fidelity=fidelity, second_order=second_order, rounds=rounds).normals
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


class TgvMinimum(NamedTuple):
    """A minimiser and its multipliers."""

    normals: Vectors  # (m, 3), unit
    jumps: Vectors  # (e, 3) v of each interior edge
    duals: Vectors  # (e, 3) multipliers of the differences D n - v; at a minimum their lengths are at most w
    corner_duals: Vectors  # (c, 3) multipliers of E v; at a minimum their lengths are at most β


def least_variation(mesh: Mesh, *, fidelity: float, second_order: float, rounds: int) -> TgvMinimum:
    """Minimise the energy of `tgv_normal` for a mesh with interior edges; lengths are in mean edge lengths.

    The differences p = D n - v and q = E v are separate unknowns, coupled by multipliers with a penalty of 1. Each
    round solves for the normals and then for the jumps, always with the same matrices and starting from the previous
    round, and shrinks the differences edge by edge and corner by corner.
    """
    given, edge, topology = mesh.face_normals, mesh.mean_edge_length or 1.0, mesh.topology
    lengths = row_distances(mesh.vertices, topology.edges[topology.interior_edges]) / edge
    lengths = np.maximum(lengths, LEAST_LENGTH)
    pull = 2 * fidelity * np.maximum(mesh.areas / edge**2, LEAST_AREA_IN_EDGES)
    difference = difference_operator(topology.face_pairs, len(mesh.faces))
    sums, corner_lengths = corner_sums(mesh)
    corner_lengths = np.maximum(corner_lengths / edge, LEAST_LENGTH)

    # The matrices α A + Dᵀ l D of the normals and l + Eᵀ l E of the jumps
    from_edges = scipy.sparse.csr_array(difference.T.multiply(lengths))
    from_corners = scipy.sparse.csr_array(sums.T.multiply(corner_lengths))
    normal_system = _system(pull, from_edges @ difference)
    jump_system = _system(lengths, from_corners @ sums)

    normals, jumps = given.copy(), np.zeros((len(lengths), 3))
    duals, ties = np.zeros_like(jumps), np.zeros_like(jumps)
    corner_duals, corner_ties = np.zeros((2, len(corner_lengths), 3))
    fixed = pull[:, None] * given
    bound, jump_bound = (TOLERANCE**2 * (scale**2).sum() for scale in (pull, lengths))
    most = np.full(len(corner_duals), second_order)
    for _ in track(rounds):
        right = fixed + from_edges @ (jumps + ties)
        conjugate_gradients(*normal_system, right, normals, bound, MOST_ITERATIONS)
        normals = unit(normals, otherwise=given)
        differences = difference @ normals
        right = lengths[:, None] * (differences - ties) + from_corners @ corner_ties
        conjugate_gradients(*jump_system, right, jumps, jump_bound, MOST_ITERATIONS)
        weights = np.exp(-(row_lengths(differences) ** 4))
        parallel_for(len(duals), _shrink, differences - jumps, weights, duals, ties)
        parallel_for(len(corner_duals), _shrink, sums @ jumps, most, corner_duals, corner_ties)
    return TgvMinimum(normals, jumps, duals, corner_duals)


def corner_sums(mesh: Mesh) -> tuple[Any, Floats]:
    """Return the matrix of second-order differences at the corners of faces, and the lengths that weight them.

    A jump is the value on the first face at an interior edge minus that on the second. The jumps at the two edges of a
    corner of face f, with opposite signs where f is the second face, sum to 2 u_f - u_g - u_h, where u_g and u_h are
    the values on the faces beyond these edges. This is the second-order difference of Liu et al. over the line from the
    corner to the centroid.
    Returns a sparse matrix (c, e), with a row for each corner between two interior edges, and (c,) lengths of the
    lines.
    """
    topology, count = mesh.topology, len(mesh.faces)
    number = np.full(len(topology.edges), -1)
    number[topology.interior_edges] = np.arange(len(topology.interior_edges))
    edges = number[topology.face_edges]  # the edge from each corner to the next
    signs = np.where(topology.face_pairs[edges, 0] == np.arange(count)[:, None], 1.0, -1.0)
    before, signs_before = np.roll(edges, 1, axis=1), np.roll(signs, 1, axis=1)
    inner = (edges >= 0) & (before >= 0)
    columns = np.stack([edges, before], axis=2)[inner]
    entries = np.stack([signs, signs_before], axis=2)[inner]
    starts = np.arange(0, entries.size + 1, 2)
    shape = len(columns), len(topology.interior_edges)
    sums = scipy.sparse.csr_array((entries.ravel(), columns.ravel(), starts), shape)
    return sums, row_lengths((mesh.corners - mesh.centroids[:, None])[inner])


def _system(diagonal: Floats, rest: Any) -> tuple[Csr, Floats]:
    """Return the pattern and the entries of a matrix, given as a diagonal and what is added to it."""
    matrix = scipy.sparse.csr_array(scipy.sparse.diags_array(diagonal) + rest)
    matrix.sort_indices()
    return Csr.of(matrix), matrix.data


@kernel
def _shrink(start: int, stop: int, differences: Vectors, thresholds: Floats, duals: Vectors, ties: Vectors) -> None:
    """Shorten d + y of each row by its threshold to the best difference p; update the multiplier y and p - y."""
    for i in range(start, stop):
        wanted = add(row(differences, i), row(duals, i))
        size = length(wanted)
        kept = max(0.0, 1.0 - thresholds[i] / size) if size > 0.0 else 0.0
        duals[i, 0], duals[i, 1], duals[i, 2] = scaled(1.0 - kept, wanted)
        ties[i, 0], ties[i, 1], ties[i, 2] = scaled(2.0 * kept - 1.0, wanted)
