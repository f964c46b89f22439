"""Total variation of face normals, by augmented Lagrangian (Zhang, Wu, Zhang, Deng 2015)."""

from collections.abc import Callable
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.baselines.vertex_fit import VertexFit, fit_vertices
from cascadenorm.baselines.vertex_update import Sweeps
from cascadenorm.compute.csr import grouped
from cascadenorm.execution.progress import track
from cascadenorm.geometry.sparse_solvers import solver
from cascadenorm.mesh import Floats, Index, Ints32, Mesh, Vectors, kernel, parallel_for, row_distances, unit
from cascadenorm.mesh.vectors import add, dot, length, row, scaled, squared_distance, subtract
from cascadenorm.registry import Parameter, method

LEAST_AREA_IN_EDGES = 1e-6  # squared mean edges; faces without area get a normal from their neighbours
PENALTY = 1.0  # of the constraint p = D n; it affects the speed of convergence, not the result
ROUND_TOLERANCE = 2e-7
"""Residual of a round against 2αA n*: on average under 1e-4 degrees from the result of exact rounds."""
MILD = 100.0  # condition up to which over-relaxation costs less than solving with factors
LEAST_RATE = 0.01  # of the residual that a sweep is taken to leave, since faces differ
MOST_SWEEPS = 400  # of one round; the next one starts where they end, so more change nothing
RESIDUAL_BLOCK = 4096  # faces whose residuals are added up, whatever the number of threads

TotalVariationFidelity = Annotated[
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
    fidelity: TotalVariationFidelity = 9.0,
    rounds: Rounds = 20,
    iterations: Repeats = 12,
    sweeps: Sweeps = 10,
    fit: VertexFit = "sweeps",
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
    values
        (m, 3) of each face, not unit.
    duals
        (e, 3) of each interior edge; at the minimum |y_e| ≤ w_e and 2αA (n - n*) + Dᵀ(l y) = 0.
    """

    values: Vectors
    duals: Vectors


class TotalVariation:
    """The energy Σ_e w_e l_e |n_1 - n_2| + α Σ_f A_f |n_f - n*_f|², w_e = exp(-|n*_1 - n*_2|⁴), lengths in mean edges.

    Differences p_e = n_1 - n_2 are unknowns of their own, tied to the normals by multipliers. In turn the normals are
    solved for, always with the same matrix, and the differences shrink edge by edge. The normals of the last round are
    near those of the next, so a few sweeps of over-relaxation do; with a low fidelity the matrix is factorised. Faces
    are renumbered by colour: a sweep then reads memory in order, and takes 30 % less time on an irregular mesh.
    """

    def __init__(self, mesh: Mesh, *, fidelity: float) -> None:
        edge, count = mesh.mean_edge_length or 1.0, len(mesh.faces)
        lengths = row_distances(mesh.vertices, mesh.topology.edges[mesh.topology.interior_edges]) / edge
        pairs = mesh.topology.face_pairs
        self.colors = grouped(_face_colors(_sides(pairs, lengths, count).across))
        self.places = np.empty(count, np.int32)
        self.places[self.colors.indices] = np.arange(count, dtype=np.int32)
        self.pairs = self.places[pairs]
        self.sides = _sides(self.pairs, lengths, count)
        self.pull = 2 * fidelity * np.maximum(mesh.areas[self.colors.indices] / edge**2, LEAST_AREA_IN_EDGES)

        # the matrix is 2αA + r Dᵀl D; the relaxation is the best (Young 1954) where all faces have the same diagonal
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
        """Minimise near the given normals n*; after 20 rounds the energy is within about 1 % of the least."""
        given, edges = given[self.colors.indices], len(self.pairs)
        weights, duals, ties = np.empty(edges), np.zeros((edges, 3)), np.zeros((edges, 3))
        parallel_for(edges, _weights, given, self.pairs, weights)
        values, right = given.copy(), np.empty_like(given)
        for _ in range(rounds):
            parallel_for(len(given), _right_side, self.sides, self.pull, given, ties, right)
            self._solve(right, values)
            parallel_for(edges, _shrink, values, self.pairs, weights, PENALTY, ties, duals)
        return Minimum(values[self.places], duals)

    def _solve(self, right: Vectors, values: Vectors) -> None:
        """Improve the normals of the round before until they solve this one; a sweep leaves ω - 1 of the residual."""
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
    """What lies at the sides of each face; a side where not exactly one other face follows has length 0.

    Parameters
    ----------
    across
        (m, 3) the other face, or the face itself.
    edges
        (m, 3) the edge, as in the pairs of faces.
    lengths
        (m, 3) its length, negative where the face is the second of its pair.
    """

    across: NDArray[np.int32]
    edges: NDArray[np.int32]
    lengths: Floats


def _sides(pairs: NDArray[np.int32], lengths: Floats, face_count: int) -> FaceSides:
    shape = face_count, 3
    across = np.repeat(np.arange(face_count, dtype=np.int32), 3).reshape(shape)
    sides = FaceSides(across, np.zeros(shape, np.int32), np.zeros(shape))
    _fill_sides(pairs, lengths, np.zeros(face_count, np.int8), sides)
    return sides


def difference_operator(pairs: NDArray[np.int32], face_count: int) -> Any:
    """Return D, (e, m) sparse: the value of the first face at an edge less that of the second."""
    signs = np.tile([1.0, -1.0], len(pairs))
    return scipy.sparse.csr_array((signs, pairs.ravel(), np.arange(0, 2 * len(pairs) + 1, 2)), (len(pairs), face_count))


@kernel
def _fill_sides(pairs: Ints32, lengths: Floats, filled: NDArray[np.int8], sides: FaceSides) -> None:
    for e in range(len(pairs)):
        f, g = pairs[e]
        if f != g:  # which a face that repeats a vertex is to itself
            for here, there, signed in ((f, g, lengths[e]), (g, f, -lengths[e])):
                side = filled[here]
                sides.across[here, side], sides.edges[here, side], sides.lengths[here, side] = there, e, signed
                filled[here] += 1


@kernel
def _face_colors(across: Ints32) -> Ints32:
    """Give each face the least colour that no face beside it has so far."""
    colors = np.full(len(across), -1, np.int32)
    for f in range(len(across)):
        color = 0
        while color in (colors[across[f, 0]], colors[across[f, 1]], colors[across[f, 2]]):
            color += 1
        colors[f] = color
    return colors


@kernel
def _weights(start: int, stop: int, given: Vectors, pairs: Ints32, weights: Floats) -> None:
    """Write exp(-|n*_1 - n*_2|⁴)."""
    for e in range(start, stop):
        squared = squared_distance(row(given, pairs[e, 0]), row(given, pairs[e, 1]))
        weights[e] = np.exp(-squared * squared)


@kernel
def _right_side(
    start: int,
    stop: int,
    sides: FaceSides,
    pull: Floats,
    given: Vectors,
    ties: Vectors,
    right: Vectors,
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
    """Solve for the faces first … last of one colour, in blocks, over-relaxed; write Σ |residual|² of each block."""
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
