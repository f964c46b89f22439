"""Pairs of faces that meet at an edge; only edges with exactly two faces take part, no rim, nothing non-manifold."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Topology


def face_pairs(topology: Topology) -> NDArray[np.int32]:
    """Return (e, 2) the two faces of each interior edge, the smaller number first."""
    first = topology.edge_faces.indptr[topology.interior_edges]
    return np.stack([topology.edge_faces.indices[first], topology.edge_faces.indices[first + 1]], axis=1)


def faces_across(topology: Topology) -> NDArray[np.int32]:
    """Return (m, 3) the face on the other side of each face side, -1 where there is none or there are several."""
    total = np.full(len(topology.edges), -1, np.int64)
    total[topology.interior_edges] = face_pairs(topology).sum(axis=1, dtype=np.int64)
    around = total[topology.face_edges]
    return np.where(around >= 0, around - np.arange(len(topology.faces))[:, None], -1).astype(np.int32)
