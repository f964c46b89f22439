"""Total variation of face normals by augmented Lagrangian (Zhang, Wu, Zhang, Deng 2015)."""

from collections.abc import Callable
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.baselines.vertex_update import Sweeps, VertexFit, fit_vertices
from cascadenorm.compute.csr import grouped
from cascadenorm.execution.progress import track
from cascadenorm.geometry.sparse_solvers import solver
from cascadenorm.mesh import Floats, Index, Ints32, Mesh, Vectors, kernel, parallel_for, row_distances, unit
from cascadenorm.mesh.vectors import add, divided, dot, length, row, scaled, squared_distance, subtract
from cascadenorm.registry import Parameter, method

LEAST_AREA_IN_EDGES = 1e-6  # in squared mean edge lengths; degenerate faces get a normal from their neighbours
PENALTY = 1.0  # weight of the constraint p = D n; it affects the speed of convergence, not the result
ROUND_TOLERANCE = 2e-7
"""Tolerance of the residual of a round relative to 2αA n*. On average, the result is within 1e-4 degrees of exact
rounds."""
MILD = 100.0  # condition number up to which over-relaxation is used instead of a factorisation
LEAST_RATE = 0.01  # lower bound on the assumed residual reduction per sweep, since faces differ
MOST_SWEEPS = 400  # limit per round; the next round continues from there, so more sweeps change nothing
RESIDUAL_BLOCK = 4096  # faces whose residuals are summed in one block, independent of the number of threads

TotalVariationFidelity = Annotated[
    float,
    Parameter(
        "α, weight of fidelity to the input normals relative to total variation",
        "1 / mean edge length",
        minimum=1e-6,
        maximum=1e6,
    ),
]
Rounds = Annotated[int, Parameter("Number of iterations of the augmented Lagrangian in each minimisation", minimum=0)]
Repeats = Annotated[int, Parameter("Number of minimisations, each started from the previous one", minimum=0)]


@method("tv-normal", source="Zhang, Wu, Zhang, Deng 2015", family="sparsity")
def tv_normal(
    mesh: Mesh,
    *,
    fidelity: TotalVariationFidelity = 9.0,
    rounds: Rounds = 20,
    iterations: Repeats = 12,
    sweeps: Sweeps = 10,
    fit: VertexFit = "sweeps",
) -> Vectors:
    """Find normals near the given ones with little total variation, then fit the vertices to them.

    The normals may jump across edges.

    Formula
    -------
    minimise Σ_e w_e l_e |n_1 - n_2| + α Σ_f A_f |n_f - n*_f|²,   w_e = exp(-|n*_1 - n*_2|⁴)
    then normalise, and repeat from the result

    Limits
    ------
    Smooth curved surfaces become patches of constant normals, the staircase effect of total variation. Contrast
    decreases with each minimisation.
    """
    variation, normals = TotalVariation(mesh, fidelity=fidelity), mesh.face_normals
    for _ in track(iterations):
        normals = unit(variation.least(normals, rounds=rounds).values, otherwise=normals)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


class Minimum(NamedTuple):
    """A minimiser and its optimality certificate."""

    values: Vectors  # (m, 3) values of the faces, not normalised
    # (e, 3) dual values of the interior edges. At the minimum |y_e| ≤ w_e and 2αA (n - n*) + Dᵀ(l y) = 0.
    duals: Vectors


class TotalVariation:
    """The energy Σ_e w_e l_e |n_1 - n_2| + α Σ_f A_f |n_f - n*_f|², w_e = exp(-|n*_1 - n*_2|⁴), lengths in mean edges.

    The differences p_e = n_1 - n_2 are separate unknowns, coupled to the normals by multipliers. A linear solve for the
    normals, always with the same matrix, alternates with a shrinkage of the differences edge by edge. The normals of
    successive rounds are close, so a few sweeps of over-relaxation suffice. With a low fidelity the matrix is
    factorised instead. Faces are renumbered by colour so that a sweep reads memory in order.
    """

    def __init__(self, mesh: Mesh, *, fidelity: float) -> None:
        edge, count = mesh.mean_edge_length or 1.0, len(mesh.faces)
        lengths = row_distances(mesh.vertices, mesh.topology.edges[mesh.topology.interior_edges]) / edge
        pairs = mesh.topology.face_pairs
        self.colors = grouped(_face_colors(mesh.topology.faces_across))
        self.places = np.empty(count, np.int32)
        self.places[self.colors.indices] = np.arange(count, dtype=np.int32)
        self.pairs = self.places[pairs]
        itself = np.repeat(np.arange(count, dtype=np.int32), 3).reshape(count, 3)
        self.sides = FaceSides(itself, np.zeros((count, 3), np.int32), np.zeros((count, 3)))
        _fill_sides(self.pairs, lengths, np.zeros(count, np.int8), self.sides)
        self.pull = 2 * fidelity * np.maximum(mesh.areas[self.colors.indices] / edge**2, LEAST_AREA_IN_EDGES)

        # The matrix is 2αA + r Dᵀl D. The relaxation is optimal (Young 1954) if all faces have the same diagonal.
        around = PENALTY * np.abs(self.sides.lengths).sum(axis=1)
        self.diagonal = self.pull + around
        self.relaxation = 2 / (1 + np.sqrt(1 - np.median(around / self.diagonal) ** 2))
        self.direct: Callable[[Vectors], Vectors] | None = None
        if 2 * np.median(self.diagonal / self.pull) >= MILD:
            difference = difference_operator(self.pairs, count)
            variation = difference.T @ scipy.sparse.diags_array(PENALTY * lengths) @ difference
            positions = mesh.centroids[self.colors.indices]
            self.direct = solver(scipy.sparse.csr_array(scipy.sparse.diags_array(self.pull) + variation), positions)

    def least(self, given: Vectors, *, rounds: int) -> Minimum:
        """Minimise near the given normals n*. After 20 rounds the energy is within about 1 % of the minimum."""
        given, edges = given[self.colors.indices], len(self.pairs)
        weights, duals = np.empty(edges), np.zeros((edges, 3))
        ties = np.zeros((max(edges, 1), 3))  # a side without an edge reads the first row
        parallel_for(edges, _weights, given, self.pairs, weights)
        values, right = given.copy(), np.empty_like(given)
        for _ in range(rounds):
            parallel_for(len(given), _right_side, self.sides, self.pull, given, ties, right)
            self._solve(right, values)
            parallel_for(edges, _shrink, values, self.pairs, weights, ties, duals)
        return Minimum(values[self.places], duals)

    def _solve(self, right: Vectors, values: Vectors) -> None:
        """Improve the previous normals until they solve this round. A sweep scales the residual by ω - 1."""
        if self.direct:
            values[:] = self.direct(right)
            return
        bound = (ROUND_TOLERANCE / max(self.relaxation - 1, LEAST_RATE)) ** 2 * (self.pull**2).sum()
        for _ in range(MOST_SWEEPS):
            squared = 0.0
            for first, last in pairwise(self.colors.indptr):
                squares = np.empty(-(-(last - first) // RESIDUAL_BLOCK))
                arrays = self.sides, self.diagonal, right, values, squares
                parallel_for(len(squares), _relax, first, last, self.relaxation, *arrays, smallest=1)
                squared += squares.sum()
            if squared <= bound:
                break


class FaceSides(NamedTuple):
    """The neighbours of each face. A side without exactly one other face has length 0."""

    across: Ints32  # (m, 3) adjacent face, or the face itself
    edges: Ints32  # (m, 3) row of the edge in the pairs of faces
    lengths: Floats  # (m, 3) length of the edge, negative if the face is the second of its pair


def difference_operator(pairs: Ints32, face_count: int) -> Any:
    """Return D, (e, m) sparse, the value of the first face at an edge minus that of the second."""
    signs = np.tile([1.0, -1.0], len(pairs))
    return scipy.sparse.csr_array((signs, pairs.ravel(), np.arange(0, 2 * len(pairs) + 1, 2)), (len(pairs), face_count))


@kernel
def _fill_sides(pairs: Ints32, lengths: Floats, filled: NDArray[np.int8], sides: FaceSides) -> None:
    for e in range(len(pairs)):
        f, g = pairs[e]
        if f != g:  # f == g for faces that repeat a vertex
            for here, there, signed in ((f, g, lengths[e]), (g, f, -lengths[e])):
                side = filled[here]
                sides.across[here, side], sides.edges[here, side], sides.lengths[here, side] = there, e, signed
                filled[here] += 1


@kernel
def _face_colors(across: Ints32) -> Ints32:
    """Give each face the smallest colour that no face across a side has so far; -1 stands for no such face."""
    colors = np.full(len(across), -1, np.int32)
    for f in range(len(across)):
        color = 0
        while color in (colors[across[f, 0]], colors[across[f, 1]], colors[across[f, 2]]):
            color += 1
        colors[f] = color
    return colors


@kernel
def _weights(start: int, stop: int, given: Vectors, pairs: Ints32, weights: Floats) -> None:
    for e in range(start, stop):
        squared = squared_distance(row(given, pairs[e, 0]), row(given, pairs[e, 1]))
        weights[e] = np.exp(-squared * squared)


@kernel
def _right_side(
    start: int, stop: int, sides: FaceSides, pull: Floats, given: Vectors, ties: Vectors, right: Vectors
) -> None:
    """Write 2αA n* + Dᵀl (rp - y)."""
    for f in range(start, stop):
        total = scaled(pull[f], row(given, f))
        for side in range(3):
            total = add(total, scaled(sides.lengths[f, side], row(ties, sides.edges[f, side])))
        right[f, 0], right[f, 1], right[f, 2] = total


@kernel
def _relax(
    start: int,
    stop: int,
    first: Index,
    last: Index,
    relaxation: float,
    sides: FaceSides,
    diagonal: Floats,
    right: Vectors,
    values: Vectors,
    squares: Floats,
) -> None:
    """Apply over-relaxation to the faces first … last of one colour, in blocks; write Σ |residual|² of each block."""
    for block in range(start, stop):
        squares[block] = 0.0
        for f in range(first + block * RESIDUAL_BLOCK, min(first + (block + 1) * RESIDUAL_BLOCK, last)):
            total = row(right, f)
            for side in range(3):
                weight = PENALTY * abs(sides.lengths[f, side])
                total = add(total, scaled(weight, row(values, sides.across[f, side])))
            residual = subtract(total, scaled(diagonal[f], row(values, f)))
            squares[block] += dot(residual, residual)
            values[f, 0], values[f, 1], values[f, 2] = add(row(values, f), scaled(relaxation / diagonal[f], residual))


@kernel
def _shrink(
    start: int, stop: int, values: Vectors, pairs: Ints32, weights: Floats, ties: Vectors, duals: Vectors
) -> None:
    """Shrink q = Dn + y/r of each edge by w/r to the optimal difference p; update the multiplier y and rp - y."""
    for e in range(start, stop):
        f, g = pairs[e]
        wanted = add(subtract(row(values, f), row(values, g)), divided(row(duals, e), PENALTY))
        size = length(wanted)
        kept = max(0.0, 1.0 - weights[e] / (PENALTY * size)) if size > 0.0 else 0.0
        rest = PENALTY * (1.0 - kept)  # y + r(Dn - p) = r(q - p)
        ties[e, 0], ties[e, 1], ties[e, 2] = scaled(PENALTY * kept - rest, wanted)
        duals[e, 0], duals[e, 1], duals[e, 2] = scaled(rest, wanted)
