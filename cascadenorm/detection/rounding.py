"""How exact the coordinates of a mesh can be at most."""

from cascadenorm.mesh import Mesh

COPLANAR = 3e-6
"""Height of a vertex over the plane of the triangle across an edge, in diagonals, up to which the two are one plane.

Coordinates in single precision come within a tenth of it; measured ones hardly ever do.
"""
SMALL_HEIGHT = 1e-3
"""Of the median edge length: the height is less than that too, where a far vertex makes the diagonal long."""


def rounding(mesh: Mesh) -> float:
    """Largest height of a vertex over a plane that rounding explains."""
    return min(COPLANAR * mesh.diagonal, SMALL_HEIGHT * mesh.median_edge_length)
