"""Rounding errors of coordinates."""

from cascadenorm.mesh import Mesh

COPLANAR = 3e-6
"""Height of a vertex above the plane of the adjacent triangle, in diagonals, up to which the two are coplanar.

Rounding to single precision stays within a tenth of it; noise of measured surfaces almost always exceeds it.
"""
SMALL_HEIGHT = 1e-3
"""Upper limit of this height in median edge lengths, for meshes with distant vertices and thus a long diagonal."""


def rounding(mesh: Mesh) -> float:
    """Return the largest height of a vertex above a plane that rounding can explain."""
    return min(COPLANAR * mesh.diagonal, SMALL_HEIGHT * mesh.median_edge_length)
