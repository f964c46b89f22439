"""Face normals after many bilateral passes, with four range spreads filtered side by side."""

import warnings
from collections.abc import Iterator

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from cascadenorm.baselines.bilateral_normal import spatial_weights
from cascadenorm.execution.progress import track
from cascadenorm.mesh import Csr, Floats32, Mesh, kernel, parallel_for

LANES = 4  # range spreads that are filtered side by side
LARGEST_AREA = 1000.0
"""Area, in median areas, above which the weight of a face no longer grows, because many passes would spread a spike."""
SLOW = (
    "the vector instructions of cascadenorm do not work with the installed numba and llvmlite: results stay the same, "
    "but learned methods take longer"
)


def iterated_bilateral_normals(
    mesh: Mesh, *, sigma_r: tuple[float, float, float, float], passes: tuple[int, ...]
) -> Iterator[NDArray[np.float32]]:
    """Filter the face normals bilaterally over one ring of faces, and yield them after each number of passes.

    The range weight is (1 - u/8)^8, which approximates e^-u and is zero for u ≥ 8. Because it needs no exponential,
    vector instructions can filter all σ_r at once.

    Parameters
    ----------
    mesh
        Mesh with m faces.
    sigma_r
        Spreads of the chords between unit normals; infinity disables the range weight. The spatial spread σ_s is one
        mean edge length.
    passes
        Numbers of passes, ascending.

    Yields
    ------
    (m, 4, 3) unit normals for the four σ_r. The next passes overwrite them.
    """
    rings, own, weights = _ring_weights(mesh)
    steepness = (0.125 * 0.5 / np.array(sigma_r) ** 2).astype(np.float32)  # range weight: (1 - steepness · chord²)^8
    assert len(steepness) == LANES
    normals = np.empty((*mesh.face_normals.shape, LANES), np.float32)
    normals[:] = mesh.face_normals[:, :, None]
    after = np.empty_like(normals)
    mesh.forget_geometry()  # the passes need memory, and these arrays are computed quickly
    for done in track(passes[-1]):
        parallel_for(len(normals), _bilateral_range, normals, own, rings, weights, steepness, after)
        normals, after = after, normals
        if done + 1 in passes:
            yield normals.transpose(0, 2, 1)


def _ring_weights(mesh: Mesh) -> tuple[Csr, NDArray[np.float32], NDArray[np.float32]]:
    """Return rings of neighbouring faces, and the weights of each face and of its neighbours in its average."""
    rings = mesh.topology.face_rings(1)
    share = 1 / np.maximum(mesh.areas / (LARGEST_AREA * mesh.median_area), 1)  # fraction of its area that counts
    own = (share * mesh.areas / mesh.median_area).astype(np.float32)
    return rings, own, spatial_weights(mesh, rings, 1.0, own)


def _filter_face(f, normals, own, rings, weights, steepness, out):  # type: ignore[no-untyped-def]
    """Filter the normals of face f, (3, LANES), with one σ_r in each lane."""
    zero, one = np.float32(0), np.float32(1)
    first, last = rings.indptr[f], rings.indptr[f + 1]
    paired = last - (last - first) % 2
    sums = np.zeros((3, 3, LANES), np.float32)  # over first neighbours of pairs, second ones, and an unpaired one

    # add the normal of each neighbour, multiplied by its range weight and its spatial weight
    for k in range(first, last):
        g, place = rings.indices[k], (k - first) % 2 if k < paired else 2
        for r in range(LANES):
            chord = zero
            for d in range(3):
                difference = normals[g, d, r] - normals[f, d, r]
                chord += difference * difference
            share = one - steepness[r] * chord
            share = share if share > zero else zero
            for _ in range(3):
                share *= share
            share *= weights[k]
            for d in range(3):
                sums[place, d, r] += share * normals[g, d, r]
    total = np.empty((3, LANES), np.float32)
    for d in range(3):
        for r in range(LANES):
            total[d, r] = own[f] * normals[f, d, r] + sums[0, d, r] + sums[1, d, r] + sums[2, d, r]

    # normalise
    for r in range(LANES):
        x, y, z = total[0, r], total[1, r], total[2, r]
        length = np.sqrt(x * x + y * y + z * z)  # powers of numpy 1 are in double precision
        for d in range(3):
            out[f, d, r] = total[d, r] / length if length > zero else normals[f, d, r]


@overload(_filter_face)
def _compiled(f, normals, own, rings, weights, steepness, out):  # type: ignore[no-untyped-def]
    """Choose what `_filter_face` is compiled to: vector instructions or, with a warning, its own loops."""
    try:
        from cascadenorm.baselines.bilateral_lanes import equals, filter_lanes

        usable = equals(_filter_face)
    except Exception:  # internal interfaces of numba and llvmlite may change in any release
        usable = False
    if not usable:
        warnings.warn(SLOW, RuntimeWarning, stacklevel=2)
        return _filter_face
    return lambda f, normals, own, rings, weights, steepness, out: filter_lanes(  # type: ignore[call-arg]
        f, normals, own, rings, weights, steepness, out
    )


@kernel
def _bilateral_range(
    start: int,
    stop: int,
    normals: Floats32,
    own: Floats32,
    rings: Csr,
    weights: Floats32,
    steepness: Floats32,
    out: Floats32,
) -> None:
    """Apply one pass of all LANES filters, each to its own normals; iteration f alone writes out[f]."""
    for f in range(start, stop):
        _filter_face(f, normals, own, rings, weights, steepness, out)  # type: ignore[no-untyped-call]
