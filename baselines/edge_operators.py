"""Second differences of the vertices across an edge (He & Schaefer 2013), which vanish where the surface is flat.

The four vertices of an edge with two faces are numbered as in the paper: the edge runs from 1 to 3; 2 and 4 are the
others of its two faces, on the right and on the left of that direction.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Mesh, Topology, Vectors, angles_between, kernel, parallel_for

STEEPEST = 1e3  # weight of a vertex at an edge that counts

EdgeOperator = Literal["area", "cotan"]


def edge_quads(topology: Topology) -> NDArray[np.int32]:
    """Return (e, 4) vertices 1, 2, 3, 4 of each edge that has exactly two faces and whose vertices differ.

    Vertex 2 belongs to the face with the smaller number; the faces need not be oriented alike.
    """
    ends = topology.edges[topology.interior_edges]
    corners = topology.faces[topology.face_pairs]  # (e, 2, 3)
    apart = (corners != ends[:, None, :1]) & (corners != ends[:, None, 1:])
    proper = (apart.sum(axis=2) == 1).all(axis=1)
    apexes = corners[proper][apart[proper]].reshape(-1, 2)
    quads = np.stack([ends[proper, 0], apexes[:, 0], ends[proper, 1], apexes[:, 1]], axis=1)
    return np.ascontiguousarray(quads[apexes[:, 0] != apexes[:, 1]])


def edge_coefficients(vertices: Vectors, quads: NDArray[np.int32], operator: EdgeOperator) -> NDArray[np.float64]:
    """Return (e, 4) weights of the vertices of each edge, so that D(e)x = Σ_k coefficient_k x_k.

    The cotangent operator is (-cot 231 - cot 134, cot 231 + cot 312, -cot 312 - cot 413, cot 134 + cot 413), of length
    |D(e)x| = 2 sin(γ/2) |x_3 - x_1| for faces that meet at π - γ. The area-based operator is that one times
    2 A_123 A_134 / (|x_3 - x_1|² (A_123 + A_134)), so that no weight grows as a triangle loses its height.
    An edge without length or of next to none, for which a weight is above 1,000, gets zeros, and for the cotangent
    operator one with a face without area.
    """
    coefficients = np.empty(quads.shape)
    parallel_for(len(quads), _edge_coefficients, vertices, quads, operator == "area", coefficients)
    return coefficients


def mean_dihedral(mesh: Mesh) -> float:
    """Mean angle in radians between the normals of the faces at an edge, unsigned, over the edges with two faces."""
    angles = angles_between(*np.moveaxis(mesh.normals[mesh.topology.face_pairs], 1, 0))
    return float(angles.mean()) if len(angles) else 0.0


@kernel
def _edge_coefficients(start, stop, vertices, quads, by_area, out):  # type: ignore[no-untyped-def]
    """Split the foot of 2 and of 4 on the edge between its ends, then balance the two heights."""
    for e in range(start, stop):
        i, j, k, l = quads[e]
        ux, uy, uz = vertices[k, 0] - vertices[i, 0], vertices[k, 1] - vertices[i, 1], vertices[k, 2] - vertices[i, 2]
        vx, vy, vz = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        wx, wy, wz = vertices[l, 0] - vertices[i, 0], vertices[l, 1] - vertices[i, 1], vertices[l, 2] - vertices[i, 2]
        squared = ux * ux + uy * uy + uz * uz
        right = np.sqrt((uy * vz - uz * vy) ** 2 + (uz * vx - ux * vz) ** 2 + (ux * vy - uy * vx) ** 2)
        left = np.sqrt((uy * wz - uz * wy) ** 2 + (uz * wx - ux * wz) ** 2 + (ux * wy - uy * wx) ** 2)
        second = fourth = 0.0
        if squared > 0.0:
            if by_area:
                total = right + left
                second = left / total if total > 0.0 else 0.5
                fourth = 1.0 - second
            elif right > 0.0 and left > 0.0:
                second, fourth = squared / right, squared / left
        along = second * (ux * vx + uy * vy + uz * vz) + fourth * (ux * wx + uy * wy + uz * wz)
        third = -along / squared if squared > 0.0 else 0.0
        if max(abs(second), abs(third), abs(fourth), abs(second + third + fourth)) > STEEPEST:
            second = third = fourth = 0.0
        out[e, 0], out[e, 1], out[e, 2], out[e, 3] = -(second + third + fourth), second, third, fourth
