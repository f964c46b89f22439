"""What a stage reads of each face: its normals after filters, B-FND and G-FND (Wang, Liu, Tong 2016) among others."""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.baselines.iterated_bilateral import iterated_bilateral_normals
from cascadenorm.baselines.normal_filter_bank import filtered_normals
from cascadenorm.baselines.smoothed_normals import smoothed_normals
from cascadenorm.mesh import Mesh, Vectors

SIGMA_S = (1.0, 2.0)
"""Spatial spreads of B-FND and G-FND, in mean edge lengths."""
SIGMA_R = (0.1, 0.2, 0.35, 0.5, np.inf)
"""Range spreads of B-FND and G-FND, chords between unit normals."""
Neighborhood = Literal["distance", "rings"]
"""Which faces B-FND and G-FND add: those within CUTOFF spatial spreads, or within RINGS rings of faces."""
CUTOFF = 2.5
RINGS = 2
ITERATED_SIGMA_R = (0.2, 0.35, 0.55, np.inf)
"""Range spreads of the iterated bilateral filters."""
ITERATED_PASSES = (1, 4, 16, 64)
"""Of the iterated bilateral filters in the first stage."""
LATER_ITERATED_PASSES = ITERATED_PASSES[:-1]
"""In the later ones."""
SMOOTHING_DIRECTION = 1 + len(ITERATED_SIGMA_R) * ITERATED_PASSES.index(4) + ITERATED_SIGMA_R.index(np.inf)
"""Number among the iterated normals of those along which vertices are smoothed: plain means, after 4 passes."""
SMOOTH_PASSES = (1, 4, 16, 64)
"""Of smoothing of the vertices in the first stage."""
LATER_SMOOTH_PASSES = (1, 2, 8)
"""In the later ones."""
SMOOTH_SIGMA_R = 0.35
"""Where the noisy mesh is smoothed along better normals, it stops at edges of that chord."""

Stack = NDArray[np.float32]
"""(m, k, 3) float32: k filtered unit normals of each of m faces."""


def bilateral_descriptor(mesh: Mesh, neighborhood: Neighborhood) -> Stack:
    """B-FND: the normal of each face after one bilateral pass for each σ_s and σ_r.

    Returns
    -------
    (m, 10, 3) : σ_r ascending within σ_s ascending
    """
    guides = np.broadcast_to(mesh.face_normals, (len(SIGMA_S), *mesh.face_normals.shape))
    return _filtered(mesh, guides, SIGMA_R, neighborhood)


def guided_descriptor(mesh: Mesh, neighborhood: Neighborhood) -> Stack:
    """B-FND and G-FND together: as `bilateral_descriptor`, then the same guided by Gaussian-filtered normals.

    The range weight of G-FND is taken on the guidance, the filter with σ_r = ∞ of the same σ_s. That filter itself is
    the same in B-FND and in G-FND, and is kept once.

    Returns
    -------
    (m, 10 + 8, 3)
    """
    plain = bilateral_descriptor(mesh, neighborhood)
    guides = plain[:, len(SIGMA_R) - 1 :: len(SIGMA_R)].swapaxes(0, 1).astype(np.float64)
    return np.concatenate([plain, _filtered(mesh, guides, SIGMA_R[:-1], neighborhood)], axis=1)


def _filtered(mesh: Mesh, guides: Vectors, sigma_r: tuple[float, ...], neighborhood: Neighborhood) -> Stack:
    rings = RINGS if neighborhood == "rings" else None
    return filtered_normals(mesh, guides, sigma_s=SIGMA_S, sigma_r=sigma_r, cutoff=CUTOFF, rings=rings)


class Descriptor(NamedTuple):
    """What a stage may read of a mesh and of how it was before the first stage.

    Parameters
    ----------
    size
        k, the number of filtered normals of each face.
    fill
        Writes them to a stack, (m, k, 3).
    rings
        Edges around the vertices of a face on which they depend, where filters B and G add rings of faces.
    filters
        How many of these follow on each other.
    """

    size: int
    fill: Callable[[Stack, Mesh, Mesh, Neighborhood], None]
    rings: int
    filters: int = 0


def _bank(describe: Callable[[Mesh, Neighborhood], Stack], count: int, *, times: int, own: bool = False) -> Descriptor:
    """B-FND, or with G-FND, behind the normal of the face itself if wanted; so many filters follow on each other."""

    def fill(out: Stack, mesh: Mesh, noisy: Mesh, neighborhood: Neighborhood) -> None:
        out[:, int(own) :] = describe(mesh, neighborhood)
        if own:
            out[:, 0] = mesh.face_normals

    return Descriptor(own + count, fill, times * RINGS, times)


def _iterated(passes: tuple[int, ...]) -> Descriptor:
    def fill(out: Stack, mesh: Mesh, noisy: Mesh, neighborhood: Neighborhood) -> None:
        iterated_bilateral_normals(mesh, sigma_r=ITERATED_SIGMA_R, passes=passes, out=out)

    return Descriptor(1 + len(ITERATED_SIGMA_R) * len(passes), fill, passes[-1])


def _smoothing(passes: tuple[int, ...]) -> int:
    """Edges that smoothed vertices depend on: those of the passes, and those of the normals around them."""
    return passes[-1] + 1 + ITERATED_PASSES[1]


def _first() -> Descriptor:
    iterated = _iterated(ITERATED_PASSES)

    def fill(out: Stack, mesh: Mesh, noisy: Mesh, neighborhood: Neighborhood) -> None:
        iterated.fill(out[:, : iterated.size], mesh, noisy, neighborhood)
        smoothed_normals(mesh, out[:, SMOOTHING_DIRECTION], SMOOTH_PASSES, out=out[:, iterated.size :])

    return Descriptor(iterated.size + len(SMOOTH_PASSES), fill, max(iterated.rings, _smoothing(SMOOTH_PASSES)))


def _later() -> Descriptor:
    """Filter what the stage before left; and smooth the noisy mesh along its normals, so that detail can come back."""
    iterated, passes = _iterated(LATER_ITERATED_PASSES), LATER_SMOOTH_PASSES

    def fill(out: Stack, mesh: Mesh, noisy: Mesh, neighborhood: Neighborhood) -> None:
        bilateral, smoothed, of_noisy = np.split(out, [iterated.size, iterated.size + len(passes)], axis=1)
        iterated.fill(bilateral, mesh, noisy, neighborhood)
        smoothed_normals(mesh, out[:, SMOOTHING_DIRECTION], passes, out=smoothed)
        smoothed_normals(noisy, mesh.face_normals, passes, sigma_r=SMOOTH_SIGMA_R, out=of_noisy)

    return Descriptor(iterated.size + 2 * len(passes), fill, max(iterated.rings, _smoothing(passes)))


_B, _G = len(SIGMA_S) * len(SIGMA_R), len(SIGMA_S) * (len(SIGMA_R) - 1)
DESCRIPTORS = {
    "B": _bank(bilateral_descriptor, _B, times=1),
    "B+G": _bank(guided_descriptor, _B + _G, times=2),
    "n+B": _bank(bilateral_descriptor, _B, times=1, own=True),
    "n+B+G": _bank(guided_descriptor, _B + _G, times=2, own=True),
    "iterated-64": _iterated(ITERATED_PASSES),
    "iterated-64+smoothed": _first(),
    "iterated-16": _iterated(LATER_ITERATED_PASSES),
    "iterated-16+smoothed": _later(),
}
"""By the name in settings and weights.

B and G are the published filters, n the normal of the face itself, with which the iterated filters begin as well.
"""
