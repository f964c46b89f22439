"""Filtered face-normal descriptors B-FND and G-FND (Wang, Liu, Tong 2016), and the pose-free numbers made of them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cascadenorm.baselines.bilateral_normal import spatial_weights
from cascadenorm.learned.smoothed import smoothed_normals
from cascadenorm.mesh import Csr, Mesh, Vectors, kernel, over, row_sums
from cascadenorm.steps import steps

SIGMA_S = (1.0, 2.0)
"""Spatial spreads of the filters, in mean edge lengths."""
SIGMA_R = (0.1, 0.2, 0.35, 0.5, np.inf)
"""Range spreads of the filters, chords between unit normals."""
RING = 2
REACH_SIGMA_R = (0.2, 0.35, 0.55, np.inf)
REACH_PASSES = (1, 4, 16, 64)
NEAR_PASSES = REACH_PASSES[:-1]
CONTEXT_STEPS = (1, 2, 4, 8)
LANES = len(REACH_SIGMA_R)
SMOOTH_PASSES = (1, 2, 4, 8, 16)
"""Of smoothing of the vertices in the first stage; the later ones leave out the last."""
SMOOTH_SIGMA_R = 0.35
"""Where the noisy mesh is smoothed along better normals, it stops at edges of that chord."""
LARGEST = 1000.0
"""No face weighs more in `reaching_stack` than one of so many median areas: a spike must not be seen from afar."""
STEADY = 1 + LANES * REACH_PASSES.index(4) + REACH_SIGMA_R.index(np.inf)
"""Number in `reaching_stack` of the normals along which vertices are smoothed."""
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


def reaching_stack(mesh: Mesh, passes: tuple[int, ...] = REACH_PASSES) -> Stack:
    """Normals after each number of bilateral passes over one ring, for each of REACH_SIGMA_R.

    In place of e^-u the range weight is (1 - u/8)^8, which is near it and zero from u = 8 on: without an exponential
    all σ_r are filtered side by side, in 12 numbers of 4 bytes a neighbour.

    Returns
    -------
    (m, 1 + 4 p, 3) : the face normal first, then σ_r ascending within the p numbers of passes ascending
    """
    rings, own, weights = _ring_weights(mesh)
    spreads = (0.5 / np.array(REACH_SIGMA_R) ** 2).astype(np.float32)
    normals = np.repeat(mesh.normals.astype(np.float32)[:, :, None], LANES, axis=2)
    after, out = np.empty_like(normals), np.empty((len(normals), 1 + LANES * len(passes), 3), np.float32)
    out[:, 0] = normals[:, :, 0]
    for done in steps(passes[-1]):
        over(len(normals), _reach_range, normals, own, *rings, weights, spreads, after)
        normals, after = after, normals
        if done + 1 in passes:
            first = 1 + LANES * passes.index(done + 1)
            out[:, first : first + LANES] = normals.transpose(0, 2, 1)
    return out


def _first(mesh: Mesh, noisy: Mesh) -> list[Stack]:
    reach = reaching_stack(mesh)
    return [reach, smoothed_normals(mesh, reach[:, STEADY], SMOOTH_PASSES)]


def _later(mesh: Mesh, noisy: Mesh) -> list[Stack]:
    """Filter what the stage before left; and smooth the noisy mesh along its normals, so that detail can come back."""
    reach, passes = reaching_stack(mesh, NEAR_PASSES), SMOOTH_PASSES[:-1]
    smoothed = smoothed_normals(mesh, reach[:, STEADY], passes)
    return [reach, smoothed, smoothed_normals(noisy, mesh.normals, passes, sigma_r=SMOOTH_SIGMA_R)]


DESCRIPTORS: dict[str, Callable[[Mesh, Mesh], list[Stack]]] = {
    "B": lambda mesh, noisy: [bilateral_stack(mesh)],
    "B+G": lambda mesh, noisy: [guided_stack(mesh)],
    "reach": lambda mesh, noisy: [reaching_stack(mesh)],
    "reach+smooth": _first,
    "near": lambda mesh, noisy: [reaching_stack(mesh, NEAR_PASSES)],
    "near+smooth": _later,
}
"""What a stage may read of a mesh and of how it was before the first stage, by the name in settings and weights."""


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
    return np.log(out, out=out)


def surroundings(values: NDArray[np.float32], mesh: Mesh) -> list[NDArray[np.float32]]:
    """Average numbers over CONTEXT_STEPS rounds of one ring, and over all that is connected.

    So a face knows what is around it at several scales, and how noisy the whole is.

    Parameters
    ----------
    values : (m, p), one row a face

    Returns
    -------
    5 of (m, p) : after 1, 2, 4 and 8 rounds, in each of which a face takes the mean of itself and the faces it touches;
        then the mean over the connected part of the mesh
    """
    rings, kept, part = mesh.topology.face_rings(1), [], mesh.topology.face_components
    sizes = np.maximum(np.bincount(part), 1)
    whole = (row_sums(part, values) / sizes[:, None]).astype(np.float32)
    spare = [np.empty_like(values), np.empty_like(values)]
    for done in range(1, CONTEXT_STEPS[-1] + 1):
        after = np.empty_like(values) if done in CONTEXT_STEPS else spare[done % 2]
        over(len(values), _mean_range, values, rings.indptr, rings.indices, after)
        values = after
        if done in CONTEXT_STEPS:
            kept.append(values)
    return [*kept, whole[part]]


def openness(mesh: Mesh) -> NDArray[np.float32]:
    """Return how far the connected part of each face is from closed, |Σ A n| / Σ A.

    What a depth camera sees from one side has other errors than a closed surface, whose fine detail they resemble.

    Returns
    -------
    (m,), from 0 where the part is closed to 1 where it is a flat sheet
    """
    part = mesh.topology.face_components
    sums = row_sums(part, mesh.area_vectors)
    areas = np.maximum(np.bincount(part, mesh.areas), np.finfo(float).tiny)
    return np.asarray((np.linalg.norm(sums, axis=1) / areas)[part], np.float32)


def _ring_weights(mesh: Mesh) -> tuple[Csr, NDArray[np.float32], NDArray[np.float32]]:
    """One ring of faces, what each face weighs in its own average, and what each of its neighbours does there."""
    rings = mesh.topology.face_rings(1)
    middling = np.median(mesh.areas[mesh.areas > 0]) if mesh.areas.any() else 1.0
    share = 1 / np.maximum(mesh.areas / (LARGEST * middling), 1)  # of its area that a face weighs
    own = (share * mesh.areas / middling).astype(np.float32)
    weights = (share[rings.indices] * spatial_weights(mesh, rings, 1.0) / middling).astype(np.float32)
    return rings, own, weights


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
def _reach_range(start, stop, normals, own, indptr, indices, weights, spreads, out):  # type: ignore[no-untyped-def]
    """One pass of LANES filters side by side, each on its own normals; iteration f alone writes out[f]."""
    total = np.empty((3, LANES), np.float32)
    zero, one, eighth = np.float32(0), np.float32(1), np.float32(0.125)
    for f in range(start, stop):
        for d in range(3):
            for r in range(LANES):
                total[d, r] = own[f] * normals[f, d, r]
        for k in range(indptr[f], indptr[f + 1]):
            g = indices[k]
            for r in range(LANES):
                x = normals[g, 0, r] - normals[f, 0, r]
                y = normals[g, 1, r] - normals[f, 1, r]
                z = normals[g, 2, r] - normals[f, 2, r]
                w = max(zero, one - eighth * spreads[r] * (x * x + y * y + z * z))
                w *= w
                w *= w
                w *= w
                w *= weights[k]
                total[0, r] += w * normals[g, 0, r]
                total[1, r] += w * normals[g, 1, r]
                total[2, r] += w * normals[g, 2, r]
        for r in range(LANES):
            length = np.sqrt(total[0, r] ** 2 + total[1, r] ** 2 + total[2, r] ** 2)
            for d in range(3):
                out[f, d, r] = total[d, r] / length if length > zero else normals[f, d, r]


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
    """1 - cos + FLOOR, cos by half the squared chord, which keeps its digits where two normals nearly agree."""
    for f in range(start, stop):
        p = 0
        for i in range(stack.shape[1]):
            for j in range(i + 1, stack.shape[1]):
                x = stack[f, i, 0] - stack[f, j, 0]
                y = stack[f, i, 1] - stack[f, j, 1]
                z = stack[f, i, 2] - stack[f, j, 2]
                out[f, p] = np.float32(0.5) * (x * x + y * y + z * z) + np.float32(FLOOR)
                p += 1
