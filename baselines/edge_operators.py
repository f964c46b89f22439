"""Second differences of the vertices across an edge (He & Schaefer 2013), which vanish where the surface is flat.

The four vertices of an edge with two faces are numbered as in the paper: the edge runs from 1 to 3; 2 and 4 are the
others of its two faces, on the right and on the left of that direction.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Floats, Ints32, Mesh, Topology, Vectors, angles_between, kernel, parallel_for
from cascadenorm.mesh.vectors import cross, dot, length, row, subtract

LARGEST_WEIGHT = 1e3  # weight of a vertex at an edge that counts

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
    angles = angles_between(*np.moveaxis(mesh.face_normals[mesh.topology.face_pairs], 1, 0))
    return float(angles.mean()) if len(angles) else 0.0


@kernel
def _edge_coefficients(start: int, stop: int, vertices: Vectors, quads: Ints32, by_area: bool, out: Floats) -> None:
    """Split the foot of 2 and of 4 on the edge between its ends, then balance the two heights."""
    for e in range(start, stop):
        i, j, k, l = quads[e]
        # the edge u, the sides v and w to the corners beside it, and twice the areas of the two faces
        u = subtract(row(vertices, k), row(vertices, i))
        v = subtract(row(vertices, j), row(vertices, i))
        w = subtract(row(vertices, l), row(vertices, i))
        squared, right, left = dot(u, u), length(cross(u, v)), length(cross(u, w))

        # the heights' factors
        second = fourth = 0.0
        if squared > 0.0:
            if by_area:
                total = right + left
                second = left / total if total > 0.0 else 0.5
                fourth = 1.0 - second
            elif right > 0.0 and left > 0.0:
                second, fourth = squared / right, squared / left
        along = second * dot(u, v) + fourth * dot(u, w)
        third = -along / squared if squared > 0.0 else 0.0
        if max(abs(second), abs(third), abs(fourth), abs(second + third + fourth)) > LARGEST_WEIGHT:
            second = third = fourth = 0.0
        out[e, 0], out[e, 1], out[e, 2], out[e, 3] = -(second + third + fourth), second, third, fourth
