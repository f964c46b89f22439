"""Fair surfaces over a region: membrane, thin plate, minimum variation, and blends between parts."""

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.errors import ParameterError
from cascadenorm.execution.progress import track
from cascadenorm.geometry.laplacians import Laplacian, Order, VertexMask, Weights, laplacian_of
from cascadenorm.geometry.sparse_solvers import solver, solver_of_rings
from cascadenorm.mesh import Mesh, Vectors, first_places


def fair(
    mesh: Mesh, region: VertexMask, *, order: Order = 2, weights: Weights = "cotan", iterations: int = 2
) -> Vectors:
    """Replace the vertices of a region by the solution of Δ^order x = 0 that the vertices around it hold.

    Parameters
    ----------
    mesh
        n vertices; where the region reaches a boundary of the mesh, the surface is free there.
    region
        (n,) bool, the vertices to replace.
    order
        1 continues the surface around the region, 2 its tangents too, 3 its curvature too.
    weights
        Of the Laplacian.
    iterations
        Solutions, each with the Laplacian of the one before.

    Returns
    -------
    (n, 3)

    Raises
    ------
    ParameterError
        A connected part of the mesh lies in the region as a whole, so that nothing holds it.
    """
    free = region & (mesh.topology.vertex_faces.counts > 0)
    _refuse_what_nothing_holds(mesh, free)
    inside = np.flatnonzero(free)
    for _ in track(iterations if len(inside) else 0):
        # P d = -P x for the displacement d, so that the vertices around keep their bits
        laplacian = laplacian_of(mesh, weights)
        energy, solve = _energy(mesh, laplacian, inside, order)
        vertices = mesh.vertices.copy()
        vertices[inside] -= solve((energy @ vertices)[inside])
        mesh = mesh.moved(vertices)
    return mesh.vertices.copy()


def blend(mesh: Mesh, seam: VertexMask, *, width: int = 3, order: Order = 2, iterations: int = 2) -> Vectors:
    """Round the join of two parts: replace the vertices within `width` rings of a seam by a fair surface.

    Parameters
    ----------
    mesh
        n vertices.
    seam
        (n,) the vertices where the parts meet.
    width
        Rings of vertices on either side that are replaced as well.
    order, iterations
        As in `fair`.

    Returns
    -------
    (n, 3)
    """
    return fair(mesh, grown(mesh, seam, rings=width), order=order, iterations=iterations)


def grown(mesh: Mesh, region: VertexMask, *, rings: int) -> VertexMask:
    """Return the region and the vertices within that many edges of it."""
    region, (i, j) = region.copy(), mesh.topology.edges.T
    for _ in range(rings):
        touched = region[i] | region[j]
        region[i[touched]] = region[j[touched]] = True
    return region


def _energy(mesh: Mesh, laplacian: Laplacian, inside: NDArray[np.int64], order: Order) -> tuple[Any, Any]:
    """Return the matrix S (W S)^(order - 1), and what solves with its rows and columns inside the region.

    W is M⁻¹, but 0 at the vertices of a boundary that stay: they have no neighbours on one side, and the Laplacian
    there would not vanish on a plane.
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


def _refuse_what_nothing_holds(mesh: Mesh, free: VertexMask) -> None:
    held = np.zeros(len(free), bool)  # by component
    held[mesh.topology.components[~free]] = True
    loose = free & ~held[mesh.topology.components]
    if loose.any():
        raise ParameterError(
            f"the region contains whole connected components ({loose.sum()} vertices: {first_places(loose)}), where "
            "the solution is not unique: leave some vertices of each component out of the region"
        )
