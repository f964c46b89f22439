"""Filtered face-normal descriptors B-FND and G-FND (Wang, Liu, Tong 2016), and the pose-free numbers made of them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cascadenorm.baselines.bilateral_normal import joint_bilateral_pass, spatial_weights
from cascadenorm.mesh import Mesh, Vectors, kernel, over

SIGMA_S = (1.0, 2.0)
"""Spatial spreads of the filters, in mean edge lengths."""
SIGMA_R = (0.1, 0.2, 0.35, 0.5, np.inf)
"""Range spreads of the filters, chords between unit normals."""
RING = 2
REACH_SIGMA_R = (0.2, 0.35, 0.55, np.inf)
REACH_PASSES = (1, 3, 8, 20)
CONTEXT_STEPS = (1, 2, 4, 8)
FLOOR = 1e-4
"""Added to 1 - cos before the logarithm: angles below half a degree count as equal."""

Stack = NDArray[np.float32]
"""(m, k, 3) float32: k filtered unit normals of each of m faces."""


def bilateral_stack(mesh: Mesh) -> Stack:
    """B-FND: the normal of each face, and that normal after one bilateral pass for each σ_s and σ_r.

    Returns
    -------
    (m, 1 + 10, 3) : the face normal first, then σ_r ascending within σ_s ascending
    """
    guides = np.broadcast_to(mesh.normals, (len(SIGMA_S), *mesh.normals.shape))
    return np.concatenate([mesh.normals[:, None].astype(np.float32), _filtered(mesh, guides, SIGMA_R)], axis=1)


def guided_stack(mesh: Mesh) -> Stack:
    """B-FND and G-FND together: as `bilateral_stack`, then the same with the range weight on Gaussian-filtered normals.

    The Gaussian guidance of a spatial spread is its filter with σ_r = ∞; guided or not, that one is the same and is
    kept once.

    Returns
    -------
    (m, 1 + 10 + 8, 3)
    """
    plain = bilateral_stack(mesh)
    guides = np.stack([plain[:, len(SIGMA_R) * (s + 1)] for s in range(len(SIGMA_S))]).astype(np.float64)
    return np.concatenate([plain, _filtered(mesh, guides, SIGMA_R[:-1])], axis=1)


def reaching_stack(mesh: Mesh) -> Stack:
    """Normals after each of REACH_PASSES bilateral passes over one ring, for each of REACH_SIGMA_R.

    Returns
    -------
    (m, 1 + 16, 3) : the face normal first, then passes ascending within σ_r ascending
    """
    rings = mesh.topology.face_rings(1)
    weights = spatial_weights(mesh, rings, 1.0)
    kept = [mesh.normals]
    for sigma_r in REACH_SIGMA_R:
        normals = mesh.normals
        for done in range(1, REACH_PASSES[-1] + 1):
            normals = joint_bilateral_pass(normals, normals, mesh.areas, rings, weights, sigma_r)
            if done in REACH_PASSES:
                kept.append(normals)
    return np.stack(kept, axis=1).astype(np.float32)


DESCRIPTORS: dict[str, Callable[[Mesh], Stack]] = {
    "B": bilateral_stack,
    "B+G": guided_stack,
    "reach": reaching_stack,
}
"""What a stage may read, by the name that configurations and weights use."""


def pose_free(stack: Stack) -> NDArray[np.float32]:
    """Turn k normals of a face into log(1 - <n_i, n_j> + FLOOR) of their pairs, which no rotation changes.

    Parameters
    ----------
    stack : (m, k, 3)

    Returns
    -------
    (m, k (k - 1) / 2), pairs i < j in row order
    """
    count = stack.shape[1]
    out = np.empty((len(stack), count * (count - 1) // 2), np.float32)
    over(len(stack), _pair_range, np.ascontiguousarray(stack), out)
    return out


def ring_means(values: NDArray[np.float32], mesh: Mesh) -> NDArray[np.float32]:
    """Average numbers over CONTEXT_STEPS rounds of one ring: what the surroundings are like, at several scales.

    Parameters
    ----------
    values : (m, p), one row a face

    Returns
    -------
    (m, 4 p) : after 1, 2, 4 and 8 rounds; in a round each face takes the mean of itself and the faces it touches
    """
    rings, kept = mesh.topology.face_rings(1), []
    for done in range(1, CONTEXT_STEPS[-1] + 1):
        before, values = np.ascontiguousarray(values), np.empty_like(values)
        over(len(values), _mean_range, before, rings.indptr, rings.indices, values)
        if done in CONTEXT_STEPS:
            kept.append(values)
    return np.concatenate(kept, axis=1)


def _filtered(mesh: Mesh, guides: Vectors, sigma_r: tuple[float, ...]) -> Stack:
    """One joint bilateral pass for each σ_s, whose guide is guides[s], and each σ_r."""
    rings = mesh.topology.face_rings(RING)
    out = np.empty((len(mesh.faces), len(SIGMA_S) * len(sigma_r), 3), np.float32)
    spatial = 0.5 / (np.array(SIGMA_S) * mesh.mean_edge_length) ** 2
    spreads = 0.5 / np.array(sigma_r) ** 2
    over(
        len(mesh.faces), _filter_range, mesh.normals, np.ascontiguousarray(guides), mesh.centroids, mesh.areas,
        rings.indptr, rings.indices, spatial, spreads, out,
    )  # fmt: skip
    return out


@kernel
def _filter_range(start, stop, normals, guides, centroids, areas, indptr, indices, spatial, spreads, out):  # type: ignore[no-untyped-def]
    """All filters of a face in one walk over its neighbours; iteration f alone writes out[f]."""
    count_s, count_r = len(spatial), len(spreads)
    total = np.empty((count_s, count_r, 3))
    for f in range(start, stop):
        for s in range(count_s):
            for r in range(count_r):
                for d in range(3):
                    total[s, r, d] = areas[f] * normals[f, d]
        for k in range(indptr[f], indptr[f + 1]):
            g = indices[k]
            x = centroids[g, 0] - centroids[f, 0]
            y = centroids[g, 1] - centroids[f, 1]
            z = centroids[g, 2] - centroids[f, 2]
            distance = x * x + y * y + z * z
            for s in range(count_s):
                near = areas[g] * np.exp(-spatial[s] * distance)
                x = guides[s, g, 0] - guides[s, f, 0]
                y = guides[s, g, 1] - guides[s, f, 1]
                z = guides[s, g, 2] - guides[s, f, 2]
                chord = x * x + y * y + z * z
                for r in range(count_r):
                    w = near if spreads[r] == 0 else near * np.exp(-spreads[r] * chord)
                    for d in range(3):
                        total[s, r, d] += w * normals[g, d]
        for s in range(count_s):
            for r in range(count_r):
                x, y, z = total[s, r]
                length = np.sqrt(x * x + y * y + z * z)
                for d in range(3):
                    out[f, s * count_r + r, d] = total[s, r, d] / length if length > 0 else normals[f, d]


@kernel
def _mean_range(start, stop, values, indptr, indices, out):  # type: ignore[no-untyped-def]
    for f in range(start, stop):
        count = np.float32(1 + indptr[f + 1] - indptr[f])
        for p in range(values.shape[1]):
            out[f, p] = values[f, p]
        for k in range(indptr[f], indptr[f + 1]):
            g = indices[k]
            for p in range(values.shape[1]):
                out[f, p] += values[g, p]
        for p in range(values.shape[1]):
            out[f, p] /= count


@kernel
def _pair_range(start, stop, stack, out):  # type: ignore[no-untyped-def]
    """1 - cos as half the squared chord, which keeps its digits where two normals nearly agree."""
    for f in range(start, stop):
        p = 0
        for i in range(stack.shape[1]):
            for j in range(i + 1, stack.shape[1]):
                x = stack[f, i, 0] - stack[f, j, 0]
                y = stack[f, i, 1] - stack[f, j, 1]
                z = stack[f, i, 2] - stack[f, j, 2]
                out[f, p] = np.log(np.float32(0.5) * (x * x + y * y + z * z) + np.float32(FLOOR))
                p += 1
