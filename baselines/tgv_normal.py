"""Total generalized variation of face normals, by augmented Lagrangian (after Liu, Li, Wang, Liu, Chen 2021)."""

from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.baselines.tv_normal import LEAST_AREA
from cascadenorm.baselines.vertex_fit import Fit, fit_vertices
from cascadenorm.baselines.vertex_update import Sweeps
from cascadenorm.execution.progress import track
from cascadenorm.geometry.conjugate_gradients import MOST_ITERATIONS, conjugate_gradients
from cascadenorm.mesh import Csr, Floats, Mesh, Vectors, row_distances, unit
from cascadenorm.registry import Parameter, method

PENALTY = 1.0  # of the ties between differences and unknowns; sets how fast the rounds converge, not to what
TOLERANCE = 1e-4  # residual of a round against 2αA n*; mean angles change by less than 1e-3 degrees
LEAST_CURVING = 1e-3  # β that the penalty of bends follows
LEAST_MASS = 1e-6  # of a gradient that no edge determines
STEEPEST = 2.0  # cotangent of the sharpest angle that the distance of circumcentres is taken from, 27°

Fidelity = Annotated[
    float,
    Parameter("α, weight of fidelity to the given normals against variation", "1 / mean edge length", minimum=1e-6),
]
Curving = Annotated[
    float,
    Parameter("β, weight of the change of the gradient against the difference to it", "mean edge lengths", minimum=0),
]
Rounds = Annotated[int, Parameter("rounds of the augmented Lagrangian in each minimisation", minimum=0)]
Repeats = Annotated[int, Parameter("minimisations, each starts from the normals of the last", minimum=0)]


@method("tgv-normal", source="after Liu, Li, Wang, Liu, Chen 2021", family="sparsity")
def tgv_normal(
    mesh: Mesh,
    *,
    fidelity: Fidelity = 4.0,
    curving: Curving = 2.0,
    rounds: Rounds = 10,
    iterations: Repeats = 6,
    sweeps: Sweeps = 10,
    fit: Fit = "sweeps",
) -> Vectors:
    """Find normals that are near the given ones and vary evenly, but may jump or begin to bend, then move the vertices.

    Formula
    -------
    minimise Σ_e w_e l_e (|n_1 - n_2 - G_e d_e| + β |G_1 - G_2|) + α Σ_f A_f |n_f - n*_f|²,   w_e = exp(-|n*_1 - n*_2|⁴)
    over the normals n and a gradient G of them in each face, then normalise, and repeat from the result
    d_e: from circumcentre to circumcentre over the edge, G_e: mean of both gradients, all in one plane by unfolding

    Limits
    ------
    Where curvature changes, it does so in steps. Creases that are weaker than the noise become bends over some edges.
    """
    normals = mesh.face_normals
    if iterations:
        variation = GeneralizedVariation(mesh, fidelity=fidelity, curving=curving)
        for _ in track(iterations):
            normals = unit(variation.least(normals, rounds=rounds).values, otherwise=normals)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


class Minimum(NamedTuple):
    """A minimiser and the proof that it is one.

    Parameters
    ----------
    values
        (m, 3) of each face, not unit.
    gradients
        (2 m, 3) of each face along the axes of its plane.
    duals
        (e, 3) of the differences at each interior edge; at the minimum |y_e| ≤ w_e.
    bending_duals
        (2 e, 3) of the differences of gradients; at the minimum |z_e| ≤ β w_e.
    """

    values: Vectors
    gradients: Vectors
    duals: Vectors
    bending_duals: Vectors


class GeneralizedVariation:
    """The energy of the formula of `tgv_normal` for a mesh, lengths in mean edges.

    Differences p = Dn - KG and q = TG at edges are unknowns of their own, tied to the normals and gradients by
    multipliers. In turn the normals and gradients are solved for, always with the same matrix and from those of the
    round before, and the differences shrink edge by edge.
    """

    def __init__(self, mesh: Mesh, *, fidelity: float, curving: float) -> None:
        edge = mesh.mean_edge_length or 1.0
        self.pairs, self.curving = mesh.topology.face_pairs, curving
        self.bend_penalty = PENALTY * max(curving, LEAST_CURVING)
        ends = mesh.topology.edges[mesh.topology.interior_edges]
        self.lengths = row_distances(mesh.vertices, ends) / edge
        self.pull = 2 * fidelity * np.maximum(mesh.areas / edge**2, LEAST_AREA)
        self.jumps, self.bends = edge_differences(mesh)

        faces = len(mesh.faces)
        mass = np.stack([self.pull, *np.full((2, faces), LEAST_MASS)], axis=1).ravel()
        self.weighted_jumps = scipy.sparse.csr_array(self.jumps.T.multiply(self.lengths))
        self.weighted_bends = scipy.sparse.csr_array(self.bends.T.multiply(np.repeat(self.lengths, 2)))
        matrix = scipy.sparse.diags_array(mass) + PENALTY * (self.weighted_jumps @ self.jumps)
        matrix = scipy.sparse.csr_array(matrix + self.bend_penalty * (self.weighted_bends @ self.bends))
        self.pattern, self.entries = Csr.of(matrix), matrix.data

    def least(self, given: Vectors, *, rounds: int) -> Minimum:
        """Minimise near the given normals n*."""
        chords = np.linalg.norm(given[self.pairs[:, 0]] - given[self.pairs[:, 1]], axis=1)
        weights = np.exp(-(chords**4))
        bound = TOLERANCE**2 * (self.pull**2).sum()
        x = np.zeros((3 * len(given), 3))
        x[::3] = given
        fixed = np.zeros_like(x)
        fixed[::3] = self.pull[:, None] * given
        duals, bending = np.zeros((len(chords), 3)), np.zeros((2 * len(chords), 3))
        ties, bending_ties = np.zeros_like(duals), np.zeros_like(bending)
        for _ in range(rounds):
            right = fixed + self.weighted_jumps @ ties + self.weighted_bends @ bending_ties
            conjugate_gradients(self.pattern, self.entries, right, x, bound, MOST_ITERATIONS)
            duals, ties = _shrunk(self.jumps @ x, duals, weights, PENALTY)
            bending, bending_ties = _shrunk(self.bends @ x, bending, self.curving * weights, self.bend_penalty)
        return Minimum(x[::3].copy(), x.reshape(-1, 3, 3)[:, 1:].reshape(-1, 3), duals, bending)


def _shrunk(differences: Vectors, duals: Vectors, weights: Floats, penalty: float) -> tuple[Vectors, Vectors]:
    """Shorten d + y/r of each edge by w/r to the best difference p; return the multiplier y and rp - y after it."""
    wanted = differences + duals / penalty
    rows = wanted.reshape(len(weights), 3 * (len(wanted) // max(len(weights), 1)))
    sizes = np.sqrt((rows**2).sum(axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        kept = np.where(sizes > 0, np.maximum(0.0, 1.0 - weights / (penalty * sizes)), 0.0)
    rest = penalty * (1.0 - kept)[:, None] * rows
    tie = penalty * kept[:, None] * rows - rest
    return rest.reshape(wanted.shape), tie.reshape(wanted.shape)


def edge_differences(mesh: Mesh) -> tuple[Any, Any]:
    """Return what edges measure of the unknowns of faces: normals, and their gradients along two axes of each face.

    The unknowns of face f are 3 f, the normal, and 3 f + 1, 3 f + 2, how it changes over one mean edge length along the
    longest side of the face and across it.

    Returns
    -------
    (e, 3 m) sparse: the normal of the first face at an interior edge less that of the second, less what the mean of
    both gradients makes of the way between their circumcentres; (2 e, 3 m) sparse: the gradient of the first face less
    that of the second, carried over by unfolding
    """
    edge, pairs = mesh.mean_edge_length or 1.0, mesh.topology.face_pairs
    ends = mesh.vertices[mesh.topology.edges[mesh.topology.interior_edges]]
    along = unit(ends[:, 1] - ends[:, 0])
    axes = _longest_sides(mesh)
    unknowns = 3 * len(mesh.faces)
    turns, heights = [], []
    for face in pairs.T:
        normal, axis = mesh.face_normals[face], axes[face]
        cosine = (along * axis).sum(axis=1)
        sine = (along * np.cross(normal, axis)).sum(axis=1)
        turns.append((cosine, sine))
        heights.append(_center_heights(mesh, face, ends) / edge)

    # the way from the second circumcentre to the first, along the edge turned left in the plane of the faces
    left = np.cross(mesh.face_normals[pairs[:, 0]], along)
    side = np.sign(((mesh.centroids[pairs[:, 0]] - ends[:, 0]) * left).sum(axis=1))
    way = side * (heights[0] + heights[1])

    # the component of a gradient to the left of the edge is cos of that across the axis less sin of that along it
    (c1, s1), (c2, s2) = turns
    first, second = 3 * pairs.T.astype(np.int64)
    ones = np.ones(len(pairs))
    columns = np.stack([first, second, first + 1, first + 2, second + 1, second + 2], axis=1)
    entries = np.stack([ones, -ones, 0.5 * way * s1, -0.5 * way * c1, 0.5 * way * s2, -0.5 * way * c2], axis=1)
    jumps = _sparse(entries, columns, unknowns)

    # components along the edge, and to its left, in turn
    columns = np.stack([first + 1, first + 2, second + 1, second + 2] * 2, axis=1)
    entries = np.stack([c1, s1, -c2, -s2, -s1, c1, s2, -c2], axis=1)
    return jumps, _sparse(entries.reshape(-1, 4), columns.reshape(-1, 4), unknowns)


def _sparse(entries: Floats, columns: NDArray[np.int64], width: int) -> Any:
    """Return the matrix with these entries in these columns of each row, both (rows, k)."""
    starts = np.arange(0, entries.size + 1, entries.shape[1])
    matrix = scipy.sparse.csr_array((entries.ravel(), columns.ravel(), starts), (len(entries), width))
    matrix.sum_duplicates()  # of edges where a face meets itself
    return matrix


def _longest_sides(mesh: Mesh) -> Vectors:
    """Direction of the longest side of each face, (m, 3)."""
    sides = np.roll(mesh.corners, -1, axis=1) - mesh.corners
    longest = (sides**2).sum(axis=2).argmax(axis=1)
    return unit(sides[np.arange(len(sides)), longest])


def _center_heights(mesh: Mesh, faces: NDArray[np.int32], ends: Vectors) -> Floats:
    """Distance of the circumcentre of each face from its side between the ends, (e,), negative where it is outside."""
    apex = mesh.corners[faces].sum(axis=1) - ends.sum(axis=1)
    u, v = ends[:, 0] - apex, ends[:, 1] - apex
    twice = np.sqrt((np.cross(u, v) ** 2).sum(axis=1))
    cosine = (u * v).sum(axis=1)
    cotangent = np.clip(np.divide(cosine, twice, out=np.zeros_like(twice), where=twice > 0), -STEEPEST, STEEPEST)
    return np.asarray(0.5 * np.sqrt(((u - v) ** 2).sum(axis=1)) * cotangent)
