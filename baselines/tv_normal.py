"""Total variation of face normals, by augmented Lagrangian (Zhang, Wu, Zhang, Deng 2015)."""

from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from cascadenorm.baselines.vertex_fit import Fit, fit_vertices
from cascadenorm.baselines.vertex_update import Sweeps
from cascadenorm.geometry.conjugate_gradients import MOST_ITERATIONS, conjugate_gradients
from cascadenorm.geometry.sparse_solvers import solver
from cascadenorm.mesh import Csr, Floats, Ints32, Mesh, Vectors, kernel, parallel_for, unit
from cascadenorm.mesh.vectors import length
from cascadenorm.progress import track
from cascadenorm.registry import Parameter, method

LEAST_AREA = 1e-6  # squared mean edges; faces without area get a normal from their neighbours
PENALTY = 1.0  # of the tie between differences and normals; sets how fast it converges, not to what
TOLERANCE = 3e-6  # residual of a round against 2αA n*: on average under 1e-3 degrees from the result of exact rounds
MILD = 100.0  # condition up to which conjugate gradients cost less than solving with factors

Fidelity = Annotated[
    float,
    Parameter(
        "α, weight of fidelity to the given normals against total variation", "1 / mean edge length", minimum=1e-6
    ),
]
Rounds = Annotated[int, Parameter("rounds of the augmented Lagrangian in each minimisation", minimum=0)]
Repeats = Annotated[int, Parameter("minimisations, each starts from the normals of the last", minimum=0)]


@method("tv-normal", source="Zhang, Wu, Zhang, Deng 2015", family="sparsity")
def tv_normal(
    mesh: Mesh,
    *,
    fidelity: Fidelity = 9.0,
    rounds: Rounds = 20,
    iterations: Repeats = 12,
    sweeps: Sweeps = 10,
    fit: Fit = "sweeps",
) -> Vectors:
    """Find normals that vary little, but may jump, near the given ones, then move the vertices to them.

    Formula
    -------
    minimise Σ_e w_e l_e |n_1 - n_2| + α Σ_f A_f |n_f - n*_f|²,   w_e = exp(-|n*_1 - n*_2|⁴)
    then normalise, and repeat from the result

    Limits
    ------
    Smooth curved surfaces become patches of constant normals, the stairs of total variation. Contrast shrinks with each
    minimisation.
    """
    variation, normals = TotalVariation(mesh, fidelity=fidelity), mesh.face_normals
    for _ in track(iterations):
        normals = unit(variation.least(normals, rounds=rounds).values, otherwise=normals)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


class Minimum(NamedTuple):
    """A minimiser and the proof that it is one.

    Parameters
    ----------
    values : (m, 3) of each face, not unit
    duals : (e, 3) of each interior edge; at the minimum |y_e| ≤ w_e and 2αA (n - n*) + Dᵀ(l y) = 0
    """

    values: Vectors
    duals: Vectors


class TotalVariation:
    """The energy Σ_e w_e l_e |n_1 - n_2| + α Σ_f A_f |n_f - n*_f|², w_e = exp(-|n*_1 - n*_2|⁴), lengths in mean edges.

    Differences p_e = n_1 - n_2 are unknowns of their own, tied to the normals by multipliers. In turn the normals are
    solved for, always with the same matrix, and the differences shrink edge by edge. The normals of the last round are
    near those of the next, so a few iterations of conjugate gradients do; with a low fidelity the matrix is factorised.
    """

    def __init__(self, mesh: Mesh, *, fidelity: float) -> None:
        edge = mesh.mean_edge_length or 1.0
        self.pairs = mesh.topology.face_pairs
        ends = mesh.vertices[mesh.topology.edges[mesh.topology.interior_edges]]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / edge
        self.pull = 2 * fidelity * np.maximum(mesh.areas / edge**2, LEAST_AREA)
        difference = difference_operator(self.pairs, len(mesh.faces))
        adjoint = sparse.csr_array(difference.T @ sparse.diags_array(lengths))
        self.adjoint, self.lengths = Csr.of(adjoint), adjoint.data
        matrix = sparse.csr_array(sparse.diags_array(self.pull) + PENALTY * (adjoint @ difference))
        self.solve: Callable[[Vectors, Vectors], Vectors]
        if 2 * np.median(matrix.diagonal() / self.pull) < MILD:
            self.solve = partial(_improved, Csr.of(matrix), matrix.data, TOLERANCE**2 * (self.pull**2).sum())
        else:
            direct = solver(matrix, mesh.centroids)
            self.solve = lambda right, _: direct(right)

    def least(self, given: Vectors, *, rounds: int) -> Minimum:
        """Minimise near the given normals n*; after 20 rounds the energy is within about 1 % of the least."""
        first, second = self.pairs.T
        weights = np.exp(-(np.linalg.norm(given[first] - given[second], axis=1) ** 4))
        values, duals, ties = given, np.zeros((len(first), 3)), np.zeros((len(first), 3))
        right = np.empty_like(given)
        for _ in range(rounds):
            parallel_for(len(given), _right_side, self.adjoint, self.lengths, self.pull, given, ties, right)
            values = self.solve(right, values)
            parallel_for(len(first), _shrink, values, self.pairs, weights, PENALTY, ties, duals)
        return Minimum(values, duals)


def _improved(pattern: Csr, entries: Floats, bound: float, right: Vectors, start: Vectors) -> Vectors:
    """Return the solution of a round, found from that of the round before."""
    values = start.copy()
    conjugate_gradients(pattern, entries, right, values, bound, MOST_ITERATIONS)
    return values


def difference_operator(pairs: NDArray[np.int32], face_count: int) -> Any:
    """Return D, (e, m) sparse: the value of the first face at an edge less that of the second."""
    signs = np.tile([1.0, -1.0], len(pairs))
    return sparse.csr_array((signs, pairs.ravel(), np.arange(0, 2 * len(pairs) + 1, 2)), (len(pairs), face_count))


@kernel
def _right_side(
    start: int,
    stop: int,
    adjoint: Csr,
    lengths: Floats,
    pull: Floats,
    given: Vectors,
    ties: Vectors,
    right: Vectors,
) -> None:
    """Write 2αA n* + Dᵀl (rp - y)."""
    for f in range(start, stop):
        x, y, z = pull[f] * given[f, 0], pull[f] * given[f, 1], pull[f] * given[f, 2]
        for k in range(adjoint.indptr[f], adjoint.indptr[f + 1]):
            e, a = adjoint.indices[k], lengths[k]
            x += a * ties[e, 0]
            y += a * ties[e, 1]
            z += a * ties[e, 2]
        right[f, 0], right[f, 1], right[f, 2] = x, y, z


@kernel
def _shrink(
    start: int,
    stop: int,
    values: Vectors,
    pairs: Ints32,
    weights: Floats,
    penalty: float,
    ties: Vectors,
    duals: Vectors,
) -> None:
    """Shorten q = Dn + y/r of each edge by w/r to the best difference p; update the multiplier y and rp - y."""
    for e in range(start, stop):
        f, g = pairs[e]
        x = values[f, 0] - values[g, 0] + duals[e, 0] / penalty
        y = values[f, 1] - values[g, 1] + duals[e, 1] / penalty
        z = values[f, 2] - values[g, 2] + duals[e, 2] / penalty
        size = length((x, y, z))
        kept = max(0.0, 1.0 - weights[e] / (penalty * size)) if size > 0.0 else 0.0
        rest = penalty * (1.0 - kept)  # y + r(Dn - p) = r(q - p)
        tie = penalty * kept - rest
        ties[e, 0], ties[e, 1], ties[e, 2] = tie * x, tie * y, tie * z
        duals[e, 0], duals[e, 1], duals[e, 2] = rest * x, rest * y, rest * z
