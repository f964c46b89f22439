"""Fair surfaces over a region: membrane, thin plate, minimum variation."""

from typing import Annotated

from cascadenorm.geometry.fairing import fair
from cascadenorm.geometry.laplacians import Order, VertexMask, Weights
from cascadenorm.mesh import Mesh, Vectors
from cascadenorm.registry import Parameter, ParameterError, method

Fairness = Annotated[
    Order, Parameter("1 membrane, 2 thin plate, 3 minimum variation; as many rings of vertices are fixed")
]


@method("fairing", source="Botsch, Kobbelt 2004; Desbrun et al. 1999", family="smoothing")
def fairing(
    mesh: Mesh,
    *,
    region: Annotated[VertexMask | None, Parameter("(n,) bool, the vertices to replace. Required")] = None,
    order: Fairness = 2,
    weights: Annotated[Weights, Parameter("Weights of the Laplacian: uniform, or cotangents")] = "cotan",
    iterations: Annotated[int, Parameter("Number of solutions, each with a new Laplacian", minimum=0)] = 2,
) -> Vectors:
    """Replace the vertices of a region by the solution of Δ^order x = 0 that continues the surface around it.

    Order 1 continues the position of the surrounding surface, 2 also its tangents, and 3 also its curvature. The
    surface is free where the region reaches a boundary of the mesh.

    Formula
    -------
    Δ^p x = 0 inside the region,   x given outside,   p the order

    Limits
    ------
    It does not denoise: all detail within the region is replaced. It suits dents, filled holes and blends.

    Raises
    ------
    ParameterError
        No region is given, or it contains a whole connected component, so that the solution is not unique.
    """
    if region is None:
        raise ParameterError("fairing needs a region: denoise with a mask of the vertices that it may replace")
    return fair(mesh, region, order=order, weights=weights, iterations=iterations)
