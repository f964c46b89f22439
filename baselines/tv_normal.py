"""Total variation of face normals, by augmented Lagrangian (Zhang, Wu, Zhang, Deng 2015)."""

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from cascadenorm.baselines.interior import face_pairs
from cascadenorm.baselines.solvers import solver
from cascadenorm.mesh import Mesh, Vectors, kernel, over, unit
from cascadenorm.recover import Sweeps, recover_vertices
from cascadenorm.registry import Parameter, method

PENALTY = 1.0  # of the tie between differences and normals; sets how fast it converges, not to what

Fidelity = Annotated[
    float, Parameter("α, weight of the given normals against their variation", "1 / mean edge length", minimum=1e-6)
]
Rounds = Annotated[int, Parameter("rounds of the augmented Lagrangian", minimum=0)]


@method("tv-normal", source="Zhang, Wu, Zhang, Deng 2015")
def tv_normal(mesh: Mesh, *, fidelity: Fidelity = 1.0, iterations: Rounds = 60, sweeps: Sweeps = 10) -> Vectors:
    """Find normals that vary little, but may jump, near the given ones, then move the vertices to them."""
    solution = least_variation(mesh, fidelity=fidelity, iterations=iterations)
    return recover_vertices(mesh, unit(solution.values, otherwise=mesh.normals), sweeps=sweeps)


class Variation(NamedTuple):
    """A minimiser and the proof that it is one.

    Parameters
    ----------
    values : (m, 3) of each face, not unit
    duals : (e, 3) of each interior edge; at the minimum |y_e| ≤ w_e and 2αA (n - n*) + Dᵀ(l y) = 0
    """

    values: Vectors
    duals: Vectors


def least_variation(mesh: Mesh, *, fidelity: float, iterations: int) -> Variation:
    """Minimise Σ_e w_e l_e |n_1 - n_2| + α Σ_f A_f |n_f - n*_f|², w_e = exp(-|n*_1 - n*_2|⁴), lengths in mean edges.

    Differences p_e = n_1 - n_2 are unknowns of their own, tied to the normals by multipliers. In turn the normals are
    solved for, always with the same matrix, which is factorised once, and the differences shrink edge by edge.
    """
    edge = mesh.mean_edge_length
    pairs = face_pairs(mesh.topology)
    given = mesh.normals
    jumps = np.linalg.norm(given[pairs[:, 0]] - given[pairs[:, 1]], axis=1)
    weights = np.exp(-(jumps**4))
    ends = mesh.vertices[mesh.topology.edges[mesh.topology.interior_edges]]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / edge
    areas = np.maximum(mesh.areas / edge**2, 1e-6)

    difference = difference_operator(pairs, len(given))
    adjoint = sparse.csr_array(difference.T @ sparse.diags_array(lengths))
    solve = solver(sparse.diags_array(2 * fidelity * areas) + PENALTY * (adjoint @ difference), mesh.centroids)
    values, duals, splits = given, np.zeros((len(pairs), 3)), np.zeros((len(pairs), 3))
    for _ in range(iterations):
        values = solve(2 * fidelity * areas[:, None] * given + adjoint @ (PENALTY * splits - duals))
        over(len(pairs), _shrink, values, pairs, weights, PENALTY, splits, duals)
    return Variation(values, duals)


def difference_operator(pairs: NDArray[np.int32], face_count: int) -> Any:
    """Return D, (e, m) sparse: the value of the first face at an edge less that of the second."""
    signs = np.tile([1.0, -1.0], len(pairs))
    return sparse.csr_array((signs, pairs.ravel(), np.arange(0, 2 * len(pairs) + 1, 2)), (len(pairs), face_count))


@kernel
def _shrink(start, stop, values, pairs, weights, penalty, splits, duals):  # type: ignore[no-untyped-def]
    """Choose the best difference p of each edge, q = Dn + y/r shortened by w/r, then update its multiplier y."""
    for e in range(start, stop):
        f, g = pairs[e]
        x = values[f, 0] - values[g, 0] + duals[e, 0] / penalty
        y = values[f, 1] - values[g, 1] + duals[e, 1] / penalty
        z = values[f, 2] - values[g, 2] + duals[e, 2] / penalty
        size = np.sqrt(x * x + y * y + z * z)
        kept = max(0.0, 1.0 - weights[e] / (penalty * size)) if size > 0.0 else 0.0
        splits[e, 0], splits[e, 1], splits[e, 2] = kept * x, kept * y, kept * z
        rest = penalty * (1.0 - kept)  # y + r(Dn - p) = r(q - p)
        duals[e, 0], duals[e, 1], duals[e, 2] = rest * x, rest * y, rest * z
