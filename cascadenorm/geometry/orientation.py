"""Faces oriented consistently, whatever orientation they came with: what normals, and so most methods, need."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Csr, Floats, Index, Ints32, Mesh, Vectors, kernel
from cascadenorm.mesh.vectors import cross, dot, row, subtract


class OrientedPatches(NamedTuple):
    """What is connected across edges of two faces.

    Parameters
    ----------
    patch
        (m,) the first face of the patch of each.
    flipped
        (m,) whether its orientation is opposite to that of this one.
    at_boundary
        (m,) whether one of its edges bounds the patch.
    single_sided
        Whether some patch cannot be oriented, as a Möbius strip.
    """

    patch: NDArray[np.int32]
    flipped: NDArray[np.bool_]
    at_boundary: NDArray[np.bool_]
    single_sided: bool


def oriented(mesh: Mesh) -> Mesh:
    """Return the mesh with the faces of each patch consistently oriented, those of closed patches outward.

    A patch is what is connected across edges of two faces; faces on the same three vertices count as one there. It
    ends where more faces meet, since there is no telling which of them continues which. A face that repeats a vertex
    is a patch of its own.

    Which way round an open patch lies is up to the majority of its faces, and to the first if there is none; a patch
    with a single side, such as a Möbius strip, keeps a seam. So the result does not depend on how the faces came, as
    long as less than half of an open patch was flipped.

    Returns
    -------
    The mesh with some faces flipped, their vertices in reverse order; `mesh` itself where none has to be
    """
    flipped = _to_flip(mesh)
    if not flipped.any():
        return mesh
    faces = mesh.faces.copy()
    faces[flipped] = faces[flipped, ::-1]
    return Mesh(mesh.vertices, faces)


def oriented_patches(mesh: Mesh) -> OrientedPatches:
    """Find the patches of a mesh, as `oriented` describes them."""
    count, around = len(mesh.faces), mesh.topology.edge_faces
    found = np.arange(count, dtype=np.int32), np.zeros(count, bool), np.zeros(count, bool)
    single_sided = _join(mesh.faces, mesh.topology.edges, around, *found)
    return OrientedPatches(*found, bool(single_sided))


def _to_flip(mesh: Mesh) -> NDArray[np.bool_]:
    """Return which faces have to be flipped, (m,)."""
    count, (patch, flipped, at_boundary, _) = len(mesh.faces), oriented_patches(mesh)
    wanted, volume = np.zeros(count), np.zeros(count)
    _weigh(mesh.vertices, mesh.faces, patch, flipped, wanted, volume)
    wanted[wanted == 0] = 1.0
    closed = volume != 0
    closed[patch[at_boundary]] = False
    np.copyto(wanted, volume, where=closed)
    wanted = wanted[patch]
    return np.where(flipped, wanted > 0, wanted < 0)


@kernel
def _weigh(vertices: Vectors, faces: Ints32, patch: Ints32, flipped: Bools, majority: Floats, volume: Floats) -> None:
    """Count the faces of each patch, those that are flipped as -1, and add six times the volume below each."""
    for f in range(len(faces)):
        origin = row(vertices, faces[patch[f], 0])
        a, b, c = row(vertices, faces[f, 0]), row(vertices, faces[f, 1]), row(vertices, faces[f, 2])
        sign = -1.0 if flipped[f] else 1.0
        majority[patch[f]] += sign
        volume[patch[f]] += sign * dot(subtract(a, origin), cross(subtract(b, origin), subtract(c, origin)))


@kernel
def _join(faces: Ints32, edges: Ints32, around: Csr, patch: Ints32, flipped: Bools, at_boundary: Bools) -> bool:
    """Number each face by the first of its patch, and tell whether its orientation is opposite to that of this one.

    Returns whether a patch has a single side.

    Until the end, `patch` leads to an earlier face of the same patch, and `flipped` is relative to that one.
    Union-find with a bit for each face. The connected components of the orientation double cover, of a spanning tree
    where a patch has a single side, are the same, but take scipy many times as long.
    """
    single_sided = False
    for e in range(len(edges)):
        a, b = edges[e]
        # an edge is passed where its faces have at most two third vertices: one face, two, or copies of these
        apexes = 0
        one: Index = -1
        other: Index = -1
        for k in range(around.indptr[e], around.indptr[e + 1]):
            apex, _ = _at_edge(faces, around.indices[k], a, b)
            if apex not in (-1, one, other):
                apexes += 1
                one, other = apex, one
        first: Index = np.int32(-1)  # as all indices here: a kernel is compiled for each type
        first_apex: Index = np.int32(-1)
        first_runs = False
        for k in range(around.indptr[e], around.indptr[e + 1]):
            f = around.indices[k]
            apex, runs = _at_edge(faces, f, a, b)
            if apex < 0:
                continue
            if apexes != 2:
                at_boundary[f] = True
            if first < 0:
                first, first_apex, first_runs = f, apex, runs
            elif apexes <= 2:
                # neighbours run along their edge in opposite ways, copies of one face in the same way
                single_sided |= _unite(patch, flipped, first, f, (runs == first_runs) != (apex == first_apex))
    for f in range(len(patch)):
        patch[f], flipped[f] = _find(patch, flipped, np.int32(f))
    return single_sided


@kernel
def _unite(patch: Ints32, flipped: Bools, f: Index, g: Index, opposed: bool) -> bool:
    """Join the patches of two faces; where they are one already, a contradiction is left, and returned as True."""
    root, odd = _find(patch, flipped, f)
    other, other_odd = _find(patch, flipped, g)
    if root != other:
        patch[max(root, other)] = min(root, other)
        flipped[max(root, other)] = odd ^ other_odd ^ opposed
        return False
    return bool(odd ^ other_odd ^ opposed)


@kernel
def _find(patch: Ints32, flipped: Bools, f: Index) -> tuple[Index, bool]:
    """Return the first face of the patch of f, and whether f is opposite to it; shortens the path there."""
    odd = False
    while patch[f] != f:
        flipped[f] ^= flipped[patch[f]]
        patch[f] = patch[patch[f]]
        odd ^= flipped[f]
        f = patch[f]
    return f, odd


@kernel
def _at_edge(faces: Ints32, f: Index, a: Index, b: Index) -> tuple[Index, bool]:
    """Return the third vertex of a face at an edge, -1 if it repeats a vertex, and whether it runs from a to b."""
    u, v, w = faces[f]
    if u == v or v == w or w == u:
        return np.int32(-1), False
    if u not in (a, b):
        return u, v == a
    if v not in (a, b):
        return v, w == a
    return w, u == a
