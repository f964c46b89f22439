"""Laplacians of a triangle mesh: cotangent with intrinsic mollification, and uniform.

Both consist of a symmetric stiffness matrix S and a diagonal mass matrix M; the Laplacian Δ = -M⁻¹S has a negative
diagonal. Boundaries need no special treatment: the cotangent Laplacian has natural (Neumann) boundary conditions, and
the uniform one uses the existing neighbours. The mesh need not be manifold: the weight of an edge sums over its faces.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
import scipy

from cascadenorm.mesh import Bools, Floats, Ints32, Mesh, Vectors, kernel, parallel_for, scatter_add
from cascadenorm.mesh.vectors import row, squared_distance

Weights = Literal["uniform", "cotan"]
Order = Literal[1, 2, 3]  # power of the Laplacian: 1 membrane or diffusion, 2 thin plate, 3 minimum variation
VertexMask = Bools  # (n,) bool mask of vertices
MOLLIFICATION = 1e-3  # slack in mean edge lengths; with less, powers of the Laplacian become inaccurate


@dataclass(frozen=True)
class Laplacian:
    """A Laplacian Δ = -M⁻¹S on the n vertices of a mesh."""

    # S, (n, n), a scipy.sparse.csr_array, symmetric and positive semidefinite; its rows sum to zero
    stiffness: Any
    mass: Floats  # M, (n,); zero for a vertex without a face, which then keeps its value
    positions: Vectors  # (n, 3) vertices, which solvers use to order the unknowns

    @cached_property
    def inverse_mass(self) -> Floats:
        """(n,) 1 / mass; 0 where the mass is 0."""
        return np.divide(1.0, self.mass, out=np.zeros_like(self.mass), where=self.mass > 0)

    def apply(self, values: Floats, order: int = 1) -> Floats:
        """Apply (-Δ)^order to the columns of `values`, (n, c)."""
        for _ in range(order):
            values = self.inverse_mass[:, None] * (self.stiffness @ values)
        return values

    def power(self, order: int) -> Any:
        """Return the sparse matrix M (-Δ)^order = S (M⁻¹S)^(order - 1), symmetric and positive semidefinite."""
        matrix = self.stiffness
        for _ in range(order - 1):
            matrix = scipy.sparse.csr_array(self.stiffness @ (scipy.sparse.diags_array(self.inverse_mass) @ matrix))
        return matrix

    @cached_property
    def largest(self) -> float:
        """Upper bound (Gershgorin) of the eigenvalues of -Δ."""
        return float((abs(self.stiffness).sum(axis=1) * self.inverse_mass).max())


def laplacian_of(mesh: Mesh, weights: Weights) -> Laplacian:
    return uniform_laplacian(mesh) if weights == "uniform" else cotangent_laplacian(mesh)


def uniform_laplacian(mesh: Mesh) -> Laplacian:
    """Return the uniform Laplacian: mean of the neighbours minus the vertex; masses are the numbers of neighbours."""
    edges = mesh.topology.edges
    return assemble(mesh, np.ones(len(edges)), mesh.topology.vertex_neighbors.counts.astype(np.float64))


def cotangent_laplacian(mesh: Mesh, *, mollification: float = MOLLIFICATION) -> Laplacian:
    """Return the cotangent Laplacian (Pinkall & Polthier 1993; Meyer et al. 2003).

    The stiffness is -(cot α + cot β)/2 for an edge with opposite angles α and β, so that Δx = -2Hn. The mass of a
    vertex is a third of the area of its faces. Triangles may be obtuse or degenerate. Mollification is the required
    slack of the triangle inequality in mean edge lengths: all edge lengths are increased by the smallest ε with which
    every triangle has this slack; ε is often 0 (Sharp & Crane 2020).
    """
    return cotangent_laplacian_of(mesh, *face_cotangents(mesh, mollification=mollification))


def cotangent_laplacian_of(mesh: Mesh, cotangents: Floats, areas: Floats) -> Laplacian:
    """Return the cotangent Laplacian from the results of `face_cotangents`."""
    edge_weights = scatter_add(mesh.topology.face_edges.ravel(), 0.5 * cotangents.ravel(), len(mesh.topology.edges))
    return assemble(mesh, edge_weights, vertex_masses(mesh, areas))


def face_cotangents(mesh: Mesh, *, mollification: float = MOLLIFICATION) -> tuple[Floats, Floats]:
    """Return the (m, 3) cotangents of the angles opposite to each side, and (m,) areas, from mollified lengths."""
    lengths = intrinsic_lengths(mesh, mollification=mollification)
    cotangents, areas = np.empty((len(mesh.faces), 3)), np.empty(len(mesh.faces))
    parallel_for(len(mesh.faces), _cotangents, lengths, cotangents, areas)
    return cotangents, areas


def vertex_masses(mesh: Mesh, areas: Floats) -> Floats:
    """Return the (n,) masses: a third of the area of the faces around each vertex."""
    return mesh.sums_around(areas / 3)


def intrinsic_lengths(mesh: Mesh, *, mollification: float = MOLLIFICATION) -> Floats:
    """Return the (m, 3) mollified side lengths of each face; side k joins corners k and k + 1."""
    lengths = np.empty(mesh.faces.shape)
    parallel_for(len(lengths), _side_lengths, mesh.vertices, mesh.faces, lengths)
    a, b, c = lengths.T
    slack = a + b + c - 2 * np.maximum(np.maximum(a, b), c)
    missing = mollification * (mesh.mean_edge_length or 1.0) - slack.min()
    return lengths + max(float(missing), 0.0)


def assemble(mesh: Mesh, weights: Floats, mass: Floats) -> Laplacian:
    """Assemble a Laplacian from edge weights, such as (cot α + cot β)/2, and vertex masses."""
    proper = mesh.topology.edges[:, 0] != mesh.topology.edges[:, 1]
    (i, j), w = mesh.topology.edges[proper].T, weights[proper]
    n = len(mesh.vertices)
    diagonal = scatter_add(i, w, n) + scatter_add(j, w, n)
    everyone = np.arange(n, dtype=np.int32)
    rows, columns = np.concatenate([i, j, everyone]), np.concatenate([j, i, everyone])
    stiffness = scipy.sparse.csr_array(
        scipy.sparse.coo_array((np.concatenate([-w, -w, diagonal]), (rows, columns)), (n, n))
    )
    return Laplacian(stiffness, mass, mesh.vertices)


@kernel
def _side_lengths(start: int, stop: int, vertices: Vectors, faces: Ints32, out: Floats) -> None:
    for f in range(start, stop):
        for k in range(3):
            out[f, k] = np.sqrt(squared_distance(row(vertices, faces[f, (k + 1) % 3]), row(vertices, faces[f, k])))


@kernel
def _cotangents(start: int, stop: int, lengths: Floats, cotangents: Floats, areas: Floats) -> None:
    """Compute opposite cotangents and areas from three lengths, with Kahan's version of Heron's formula."""
    for f in range(start, stop):
        a, b, c = lengths[f]
        low, high = min(a, b, c), max(a, b, c)
        middle = max(min(a, b), min(max(a, b), c))
        squared = (high + (middle + low)) * (low - (high - middle)) * (low + (high - middle)) * (high + (middle - low))
        area = 0.25 * np.sqrt(squared)
        areas[f] = area
        cotangents[f, 0] = (b * b + c * c - a * a) / (4.0 * area)
        cotangents[f, 1] = (c * c + a * a - b * b) / (4.0 * area)
        cotangents[f, 2] = (a * a + b * b - c * c) / (4.0 * area)
