"""Filtered normals in two thirds of their memory.

A unit vector is stored as two numbers, its octahedral coordinates (Meyer et al., On Floating-Point Normal Vectors,
2010): the point where its direction meets the octahedron |x| + |y| + |z| = 1, whose lower half is unfolded around the
upper one. Both directions round like single precision.
"""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Floats32, kernel, parallel_for

PackedNormals = NDArray[np.float32]
"""(m, k, 2) float32: k unit normals of each of m faces in octahedral coordinates. The memory layout is (k, 2, m), so
that each filter writes contiguously and loops over faces can be vectorised."""
NO_NORMAL = 2.0
"""First coordinate of the normal of a face without area, which is zero. Those of unit normals are at most 1."""
TILE = 256
"""Number of faces whose normals are converted together. Their normals fit into the L1 cache."""


def no_normals(faces: int, count: int) -> PackedNormals:
    """Return space for `count` normals of each face."""
    return np.empty((count, 2, faces), np.float32).transpose(2, 0, 1)


def pack(normals: NDArray[np.float32], out: PackedNormals) -> None:
    """Write normals, (m, k, 3), as octahedral coordinates to `out`, (m, k, 2)."""
    parallel_for(len(out), _pack_range, normals, out.transpose(1, 2, 0))


def unpacked(normals: PackedNormals) -> NDArray[np.float32]:
    """Return packed normals as vectors, (m, k, 3), with the memory layout (k, 3, m)."""
    by_filter = np.ascontiguousarray(normals.transpose(1, 2, 0))
    out = np.empty((len(by_filter), 3, len(normals)), np.float32)
    parallel_for(len(normals), _unpack_range, by_filter, out)
    return out.transpose(2, 0, 1)


@kernel
def _pack_range(start: int, stop: int, normals: Floats32, out: PackedNormals) -> None:
    """Convert normals, (m, k, 3), to coordinates, (k, 2, m)."""
    zero, one, none = np.float32(0), np.float32(1), np.float32(NO_NORMAL)
    tile = np.empty((3, TILE), np.float32)
    xs, ys, zs = tile
    for begin in range(start, stop, TILE):
        count = min(TILE, stop - begin)
        some = slice(begin, begin + count)
        for k in range(len(out)):
            for f in range(count):
                xs[f], ys[f], zs[f] = normals[begin + f, k, 0], normals[begin + f, k, 1], normals[begin + f, k, 2]
            first, second = out[k, 0, some], out[k, 1, some]
            for f in range(count):  # without branches, so that the loop is vectorised
                x, y, z = xs[f], ys[f], zs[f]
                size = abs(x) + abs(y) + abs(z)
                length = size if size > zero else one
                u, v = x / length, y / length
                right, ahead = one - abs(v), one - abs(u)  # of the lower half, unfolded
                right, ahead = right if u >= zero else -right, ahead if v >= zero else -ahead
                u, v = right if z < zero else u, ahead if z < zero else v
                first[f], second[f] = u if size > zero else none, v if size > zero else zero


@kernel
def _unpack_range(start: int, stop: int, normals: PackedNormals, out: Floats32) -> None:
    """Convert coordinates, (k, 2, m), to normals, (k, 3, m)."""
    zero, one = np.float32(0), np.float32(1)
    for k in range(len(out)):
        (first, second), (x, y, z) = normals[k], out[k]
        for f in range(start, stop):
            u, v = first[f], second[f]
            up = one - abs(u) - abs(v)
            below = -up if up < zero else zero
            right, ahead = u - (below if u >= zero else -below), v - (below if v >= zero else -below)
            share = one / np.sqrt(right * right + ahead * ahead + up * up)
            share = share if u < np.float32(NO_NORMAL) else zero
            x[f], y[f], z[f] = share * right, share * ahead, share * up
