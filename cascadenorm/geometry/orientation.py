"""Consistent orientation of faces."""

from typing import NamedTuple

import numpy as np

from cascadenorm.mesh import Bools, Csr, Floats, Index, Ints32, Mesh, Vectors, kernel
from cascadenorm.mesh.vectors import cross, dot, row, subtract


class OrientedPatches(NamedTuple):
    """Patches of faces connected across manifold edges."""

    patch: Ints32  # (m,) first face of each face's patch
    flipped: Bools  # (m,) whether each face is oriented opposite to that face
    at_boundary: Bools  # (m,) whether each face has an edge on the boundary of its patch


def oriented(mesh: Mesh) -> Mesh:
    """Orient the faces of each patch consistently, and closed patches outward.

    A patch is a set of faces connected across edges with two faces, where faces on the same three vertices count as
    one. Patches end at non-manifold edges, since it is ambiguous which of the faces there continue each other. A face
    that repeats a vertex is a patch of its own.

    The majority of its faces determines the orientation of an open patch, or the first face in a tie. A non-orientable
    patch, such as a Möbius strip, keeps a seam. The result is therefore independent of the input orientation as long as
    fewer than half of the faces of an open patch are flipped. Flipped faces have their vertices in reverse order; if
    there are none, the result is `mesh` itself.
    """
    flipped = _to_flip(mesh)
    return with_flipped(mesh, flipped) if flipped.any() else mesh


def with_flipped(mesh: Mesh, flipped: Bools) -> Mesh:
    """Return the mesh with the vertices of some faces, (m,) bool, in reverse order."""
    faces = mesh.faces.copy()
    faces[flipped] = faces[flipped, ::-1]
    return Mesh(mesh.vertices, faces)


def oriented_patches(mesh: Mesh) -> OrientedPatches:
    """Find the patches of a mesh, as `oriented` describes them."""
    count, around = len(mesh.faces), mesh.topology.edge_faces
    found = np.arange(count, dtype=np.int32), np.zeros(count, bool), np.zeros(count, bool)
    _join(mesh.faces, mesh.topology.edges, around, *found)
    return OrientedPatches(*found)


def _to_flip(mesh: Mesh) -> Bools:
    """Return (m,) whether each face must be flipped."""
    count, (patch, flipped, at_boundary) = len(mesh.faces), oriented_patches(mesh)
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
    """Sum the signs of the faces of each patch, -1 if flipped, and six times the signed volume below each face."""
    for f in range(len(faces)):
        origin = row(vertices, faces[patch[f], 0])
        a, b, c = row(vertices, faces[f, 0]), row(vertices, faces[f, 1]), row(vertices, faces[f, 2])
        sign = -1.0 if flipped[f] else 1.0
        majority[patch[f]] += sign
        volume[patch[f]] += sign * dot(subtract(a, origin), cross(subtract(b, origin), subtract(c, origin)))


@kernel
def _join(faces: Ints32, edges: Ints32, around: Csr, patch: Ints32, flipped: Bools, at_boundary: Bools) -> None:
    """Find the first face of each face's patch, the relative orientation, and the faces at the boundary of a patch.

    The algorithm is union-find with a parity bit per face. Until the last loop, `patch` refers to an earlier face of
    the same patch, and `flipped` is relative to that face.
    """
    for e in range(len(edges)):
        a, b = edges[e]
        # an edge joins its faces if they have at most two distinct third vertices: one face, two, or copies of them
        apexes = 0
        one: Index = -1
        other: Index = -1
        for k in range(around.indptr[e], around.indptr[e + 1]):
            apex, _ = _at_edge(faces, around.indices[k], a, b)
            if apex not in (-1, one, other):
                apexes += 1
                one, other = apex, one
        first: Index = np.int32(-1)  # one index type throughout: kernels are compiled for each type
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
                # neighbours traverse their edge in opposite directions, copies of a face in the same direction
                _unite(patch, flipped, first, f, (runs == first_runs) != (apex == first_apex))
    for f in range(len(patch)):
        patch[f], flipped[f] = _find(patch, flipped, np.int32(f))


@kernel
def _unite(patch: Ints32, flipped: Bools, f: Index, g: Index, opposed: bool) -> None:
    """Join the patches of two faces; if they are in the same patch, a contradictory orientation is ignored."""
    root, odd = _find(patch, flipped, f)
    other, other_odd = _find(patch, flipped, g)
    if root != other:
        patch[max(root, other)] = min(root, other)
        flipped[max(root, other)] = odd ^ other_odd ^ opposed


@kernel
def _find(patch: Ints32, flipped: Bools, f: Index) -> tuple[Index, bool]:
    """Return the root face of f's patch and whether f is opposite to it, halving the path."""
    odd = False
    while patch[f] != f:
        flipped[f] ^= flipped[patch[f]]
        patch[f] = patch[patch[f]]
        odd ^= flipped[f]
        f = patch[f]
    return f, odd


@kernel
def _at_edge(faces: Ints32, f: Index, a: Index, b: Index) -> tuple[Index, bool]:
    """Return the third vertex of a face, -1 if it repeats one, and whether the face traverses the edge from a to b."""
    u, v, w = faces[f]
    if u == v or v == w or w == u:
        return np.int32(-1), False
    if u not in (a, b):
        return u, v == a
    if v not in (a, b):
        return v, w == a
    return w, u == a
