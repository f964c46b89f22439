"""Fairing of regions (membrane, thin plate, minimum variation)."""

from typing import Any

import numpy as np
import scipy

from cascadenorm.errors import ParameterError
from cascadenorm.execution.progress import track
from cascadenorm.geometry.laplacians import Laplacian, Order, VertexMask, Weights, laplacian_of
from cascadenorm.geometry.sparse_solvers import solver, solver_of_rings
from cascadenorm.mesh import Ints, Mesh, Vectors, first_places, marked


def fair(
    mesh: Mesh, region: VertexMask, *, order: Order = 2, weights: Weights = "cotan", iterations: int = 2
) -> Vectors:
    """Replace the vertices of a region, (n,), by the solution of Δ^order x = 0 with the surrounding vertices fixed.

    Order 1 continues the position of the surrounding surface, 2 also its tangents, 3 also its curvature. The surface is
    free where the region reaches a boundary of the mesh. Each iteration solves with the Laplacian of the previous
    solution, with these weights. Returns (n, 3) vertices. Raises ParameterError if the region contains a whole
    connected component, so that the solution is not unique.
    """
    free = region & (mesh.topology.vertex_faces.counts > 0)
    _check_held(mesh, free)
    inside = np.flatnonzero(free)
    for _ in track(iterations if len(inside) else 0):
        # solve P d = -P x for the displacement d, so that the surrounding vertices stay byte-identical
        laplacian = laplacian_of(mesh, weights)
        energy, solve = _energy(mesh, laplacian, inside, order)
        vertices = mesh.vertices.copy()
        vertices[inside] -= solve((energy @ vertices)[inside])
        mesh = mesh.moved(vertices)
    return mesh.vertices.copy()


def _energy(mesh: Mesh, laplacian: Laplacian, inside: Ints, order: Order) -> tuple[Any, Any]:
    """Return the matrix S (W S)^(order - 1), and a solver for its submatrix inside the region.

    W is M⁻¹, but 0 at fixed boundary vertices: they have neighbours on one side only, so their Laplacian would not
    vanish on a plane.
    """
    fixed_boundary = mesh.topology.boundary_vertices.copy()
    fixed_boundary[inside] = False
    held = Laplacian(laplacian.stiffness, np.where(fixed_boundary, 0, laplacian.mass), laplacian.positions)
    energy = held.power(order)
    matrix, positions = scipy.sparse.csr_array(energy[inside][:, inside]), mesh.vertices[inside]
    if order == 1:
        return energy, solver(matrix, positions)
    root = laplacian.stiffness[inside][:, inside]
    return energy, solver_of_rings(matrix, root, laplacian.mass[inside], positions, order=order)


def _check_held(mesh: Mesh, free: VertexMask) -> None:
    held = marked(mesh.topology.components[~free], len(free))  # for each component
    loose = free & ~held[mesh.topology.components]
    if loose.any():
        raise ParameterError(
            f"the region contains whole connected components ({loose.sum()} vertices: {first_places(loose)}), where "
            "the solution is not unique: leave some vertices of each component out of the region"
        )
