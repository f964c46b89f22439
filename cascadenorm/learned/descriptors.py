"""Descriptors: the filtered normals of each face that a stage reads.

They include B-FND and G-FND (Wang, Liu, Tong 2016).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.baselines.iterated_bilateral import iterated_bilateral_normals
from cascadenorm.baselines.normal_filter_bank import filtered_normals
from cascadenorm.baselines.smoothed_normals import smoothed_normals
from cascadenorm.learned.packed_normals import PackedNormals, pack, unpacked
from cascadenorm.mesh import Floats, Floats32, Mesh

SIGMA_S = (1.0, 2.0)
"""Spatial spreads of B-FND and G-FND, in mean edge lengths."""
SIGMA_R = (0.1, 0.2, 0.35, 0.5, np.inf)
"""Range spreads of B-FND and G-FND, chords between unit normals."""
CUTOFF = 2.5
"""Distance in spatial spreads within which B-FND and G-FND sum over faces."""
ITERATED_SIGMA_R = (0.2, 0.35, 0.55, np.inf)
"""Range spreads of the iterated bilateral filters."""
ITERATED_16 = (1, 4, 16)
"""Passes of the iterated bilateral filters in later stages."""
ITERATED_32, ITERATED_64 = (*ITERATED_16, 32), (*ITERATED_16, 64)
"""Passes of the iterated bilateral filters in the first stage."""
SMOOTHING_DIRECTION = 1 + len(ITERATED_SIGMA_R) * ITERATED_16.index(4) + ITERATED_SIGMA_R.index(np.inf)
"""Index of the iterated normals along which vertices are smoothed: unweighted means after 4 passes."""
SMOOTH_PASSES = (1, 4, 16, 64)
"""Passes of vertex smoothing in the first stage."""
LATER_SMOOTH_PASSES = (1, 2, 8)
"""Passes of vertex smoothing in later stages."""
SMOOTH_SIGMA_R = 0.35
"""Range spread for smoothing the noisy mesh along better normals, a chord. Smoothing stops at such edges."""

Stack = NDArray[np.float32]
"""(m, k, 3) float32: k filtered unit normals of each of m faces."""


def bilateral_descriptor(mesh: Mesh) -> Stack:
    """Compute B-FND: the normal of each face after one bilateral pass for each σ_s and σ_r.

    Returns
    -------
    (m, 10, 3) unit normals, σ_r ascending within σ_s ascending.
    """
    guides = np.broadcast_to(mesh.face_normals, (len(SIGMA_S), *mesh.face_normals.shape))
    return _filtered(mesh, guides, SIGMA_R)


def guided_descriptor(mesh: Mesh) -> Stack:
    """Compute B-FND and G-FND, in which the normals are guided by Gaussian-filtered ones.

    The guidance of G-FND, from which the range weights are computed, is the filter with σ_r = ∞ of the same σ_s. That
    filter itself is the same in B-FND and in G-FND and is included once.

    Returns
    -------
    (m, 10 + 8, 3) unit normals.
    """
    plain = bilateral_descriptor(mesh)
    guides = plain[:, len(SIGMA_R) - 1 :: len(SIGMA_R)].swapaxes(0, 1)
    return np.concatenate([plain, _filtered(mesh, guides, SIGMA_R[:-1])], axis=1)


def _filtered(mesh: Mesh, guides: Floats | Floats32, sigma_r: tuple[float, ...]) -> Stack:
    return filtered_normals(mesh, guides, sigma_s=SIGMA_S, sigma_r=sigma_r, cutoff=CUTOFF)


class Descriptor(NamedTuple):
    """Filtered normals computed from a mesh before a stage and from the noisy mesh."""

    size: int  # k, the number of filtered normals per face
    fill: Callable[[PackedNormals, Mesh, Mesh], None]  # writes them to packed normals, (m, k, 3)
    rings: int  # edges within which the normals depend on the mesh, except for filters B and G
    filters: int = 0  # number of filters B and G that are applied one after the other


def _pack_own(out: PackedNormals, mesh: Mesh) -> None:
    """Write the face normals to the first of the packed normals."""
    pack(mesh.face_normals.astype(np.float32)[:, None], out[:, :1])


def _bank(describe: Callable[[Mesh], Stack], count: int, *, times: int, own: bool = False) -> Descriptor:
    """Return B-FND, with or without G-FND, optionally preceded by the face normal, as `times` successive filters."""

    def fill(out: PackedNormals, mesh: Mesh, noisy: Mesh) -> None:
        pack(describe(mesh), out[:, int(own) :])
        if own:
            _pack_own(out, mesh)

    return Descriptor(own + count, fill, 0, times)


def _iterated(passes: tuple[int, ...]) -> Descriptor:
    def fill(out: PackedNormals, mesh: Mesh, noisy: Mesh) -> None:
        _pack_own(out, mesh)
        each = iterated_bilateral_normals(mesh, sigma_r=ITERATED_SIGMA_R, passes=passes)
        for place, normals in zip(range(1, out.shape[1], len(ITERATED_SIGMA_R)), each, strict=True):
            pack(normals, out[:, place : place + len(ITERATED_SIGMA_R)])
        mesh.topology.forget_adjacent_faces()  # later filters need memory, but not these relations

    return Descriptor(1 + len(ITERATED_SIGMA_R) * len(passes), fill, passes[-1])


def _pack_smoothed(
    out: PackedNormals, mesh: Mesh, along: Floats | Stack, passes: tuple[int, ...], *, sigma_r: float = np.inf
) -> None:
    """Write the normals between smoothed vertices, one for each number of passes."""
    for place, normals in enumerate(smoothed_normals(mesh, along, passes, sigma_r=sigma_r)):
        pack(normals[:, None], out[:, place : place + 1])


def _direction(out: PackedNormals) -> Stack:
    """Return the iterated normals along which vertices are smoothed, (m, 3)."""
    return unpacked(out[:, SMOOTHING_DIRECTION : SMOOTHING_DIRECTION + 1])[:, 0]


def _smoothing(passes: tuple[int, ...]) -> int:
    """Return the reach of smoothed vertices in edges: their passes plus the reach of the normals around them."""
    return passes[-1] + 1 + ITERATED_16[1]


def _first(passes: tuple[int, ...]) -> Descriptor:
    iterated = _iterated(passes)

    def fill(out: PackedNormals, mesh: Mesh, noisy: Mesh) -> None:
        iterated.fill(out[:, : iterated.size], mesh, noisy)
        _pack_smoothed(out[:, iterated.size :], mesh, _direction(out), SMOOTH_PASSES)

    return Descriptor(iterated.size + len(SMOOTH_PASSES), fill, max(iterated.rings, _smoothing(SMOOTH_PASSES)))


def _later() -> Descriptor:
    """Filter the current mesh, and smooth the noisy mesh along the current normals, which can restore detail."""
    iterated, passes = _iterated(ITERATED_16), LATER_SMOOTH_PASSES

    def fill(out: PackedNormals, mesh: Mesh, noisy: Mesh) -> None:
        bilateral, smoothed, of_noisy = np.split(out, [iterated.size, iterated.size + len(passes)], axis=1)
        iterated.fill(bilateral, mesh, noisy)
        _pack_smoothed(smoothed, mesh, _direction(out), passes)
        _pack_smoothed(of_noisy, noisy, mesh.face_normals, passes, sigma_r=SMOOTH_SIGMA_R)

    return Descriptor(iterated.size + 2 * len(passes), fill, max(iterated.rings, _smoothing(passes)))


_B, _G = len(SIGMA_S) * len(SIGMA_R), len(SIGMA_S) * (len(SIGMA_R) - 1)
DESCRIPTORS = {
    "B": _bank(bilateral_descriptor, _B, times=1),
    "B+G": _bank(guided_descriptor, _B + _G, times=2),
    "n+B": _bank(bilateral_descriptor, _B, times=1, own=True),
    "n+B+G": _bank(guided_descriptor, _B + _G, times=2, own=True),
    "iterated-64": _iterated(ITERATED_64),
    "iterated-64+smoothed": _first(ITERATED_64),
    "iterated-32+smoothed": _first(ITERATED_32),
    "iterated-16": _iterated(ITERATED_16),
    "iterated-16+smoothed": _later(),
}
"""Descriptors by their names in settings and weights.

B and G are the published filters; n is the face normal, which also comes first in the iterated descriptors."""
