"""Measure the volume and the topology of closed components."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.geometry.volume import closed_parts, volumes
from cascadenorm.mesh import Mesh


class Enclosed(NamedTuple):
    """The closed, consistently oriented components of a mesh."""

    faces: NDArray[np.int64]  # (c,) first face of each component
    volumes: NDArray[np.float64]  # (c,) signed volumes; negative for components that are inside out
    # (c,) Euler characteristics V - E + F, which are 2 - 2 · handles for manifold components
    characteristics: NDArray[np.int64]
    manifold: NDArray[np.bool_]  # (c,) bool, whether every vertex of the component has a single fan of faces


def enclosed(mesh: Mesh, pinched: NDArray[np.bool_]) -> Enclosed:
    """Measure the closed components of a mesh; pinched vertices, (n,) bool, have several fans of faces."""
    closed = closed_parts(mesh)
    number, total = closed
    of_face, of_edge = number[mesh.faces[:, 0]], number[mesh.topology.edges[:, 0]]
    inside = np.flatnonzero(of_face >= 0)
    parts, first = np.unique(of_face[inside], return_index=True)
    assert len(parts) == total
    counts = [np.bincount(of[of >= 0], minlength=total) for of in (number, of_edge, of_face)]
    manifold = np.ones(total, bool)
    of_pinched = number[pinched]
    manifold[of_pinched[of_pinched >= 0]] = False
    return Enclosed(inside[first], volumes(mesh, closed), counts[0] - counts[1] + counts[2], manifold)
