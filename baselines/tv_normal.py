"""Total variation of face normals, by augmented Lagrangian (Zhang, Wu, Zhang, Deng 2015)."""

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from cascadenorm.baselines.vertex_fit import Fit, fit_vertices
from cascadenorm.baselines.vertex_update import Sweeps
from cascadenorm.geometry.sparse_solvers import solver
from cascadenorm.mesh import Floats, Ints32, Mesh, Vectors, kernel, parallel_for, unit
from cascadenorm.mesh.vectors import length
from cascadenorm.progress import track
from cascadenorm.registry import Parameter, method

LEAST_AREA = 1e-6  # squared mean edges; faces without area get a normal from their neighbours
PENALTY = 1.0  # of the tie between differences and normals; sets how fast it converges, not to what

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
    variation, normals = TotalVariation(mesh, fidelity=fidelity), mesh.normals
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
    solved for, always with the same matrix, which is factorised once, and the differences shrink edge by edge.
    """

    def __init__(self, mesh: Mesh, *, fidelity: float) -> None:
        edge = mesh.mean_edge_length or 1.0
        self.pairs = mesh.topology.face_pairs
        ends = mesh.vertices[mesh.topology.edges[mesh.topology.interior_edges]]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / edge
        self.pull = 2 * fidelity * np.maximum(mesh.areas / edge**2, LEAST_AREA)
        difference = difference_operator(self.pairs, len(mesh.faces))
        self.adjoint = sparse.csr_array(difference.T @ sparse.diags_array(lengths))
        matrix = sparse.diags_array(self.pull) + PENALTY * (self.adjoint @ difference)
        self.solve = solver(matrix, mesh.centroids)

    def least(self, given: Vectors, *, rounds: int) -> Minimum:
        """Minimise near the given normals n*; after 20 rounds the energy is within about 1 % of the least."""
        first, second = self.pairs.T
        weights = np.exp(-(np.linalg.norm(given[first] - given[second], axis=1) ** 4))
        values, duals, splits = given, np.zeros((len(first), 3)), np.zeros((len(first), 3))
        for _ in range(rounds):
            values = self.solve(self.pull[:, None] * given + self.adjoint @ (PENALTY * splits - duals))
            parallel_for(len(first), _shrink, values, self.pairs, weights, PENALTY, splits, duals)
        return Minimum(values, duals)


def difference_operator(pairs: NDArray[np.int32], face_count: int) -> Any:
    """Return D, (e, m) sparse: the value of the first face at an edge less that of the second."""
    signs = np.tile([1.0, -1.0], len(pairs))
    return sparse.csr_array((signs, pairs.ravel(), np.arange(0, 2 * len(pairs) + 1, 2)), (len(pairs), face_count))


@kernel
def _shrink(
    start: int,
    stop: int,
    values: Vectors,
    pairs: Ints32,
    weights: Floats,
    penalty: float,
    splits: Vectors,
    duals: Vectors,
) -> None:
    """Choose the best difference p of each edge, q = Dn + y/r shortened by w/r, then update its multiplier y."""
    for e in range(start, stop):
        f, g = pairs[e]
        x = values[f, 0] - values[g, 0] + duals[e, 0] / penalty
        y = values[f, 1] - values[g, 1] + duals[e, 1] / penalty
        z = values[f, 2] - values[g, 2] + duals[e, 2] / penalty
        size = length((x, y, z))
        kept = max(0.0, 1.0 - weights[e] / (penalty * size)) if size > 0.0 else 0.0
        splits[e, 0], splits[e, 1], splits[e, 2] = kept * x, kept * y, kept * z
        rest = penalty * (1.0 - kept)  # y + r(Dn - p) = r(q - p)
        duals[e, 0], duals[e, 1], duals[e, 2] = rest * x, rest * y, rest * z
