"""Filtered face-normal descriptors B-FND and G-FND (Wang, Liu, Tong 2016), and the pose-free numbers made of them."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.baselines.iterated_bilateral import NEAR_PASSES, REACH_PASSES, REACH_SIGMA_R, STEADY, reaching_stack
from cascadenorm.baselines.normal_filter_bank import filtered_normals
from cascadenorm.baselines.smoothed_normals import smoothed_normals
from cascadenorm.mesh import Mesh, Vectors, kernel, parallel_for, scatter_add

SIGMA_S = (1.0, 2.0)
"""Spatial spreads of the filters, in mean edge lengths."""
SIGMA_R = (0.1, 0.2, 0.35, 0.5, np.inf)
"""Range spreads of the filters, chords between unit normals."""
RING = 2
CONTEXT_STEPS = (1, 2, 4, 8)
SMOOTH_PASSES = (1, 2, 4, 8, 16, 64)
"""Of smoothing of the vertices in the first stage."""
NEAR_SMOOTH_PASSES = SMOOTH_PASSES[:-2]
"""In the later ones."""
SMOOTH_SIGMA_R = 0.35
"""Where the noisy mesh is smoothed along better normals, it stops at edges of that chord."""
FLOOR = 1e-4
"""Added to 1 - cos before the logarithm: angles below half a degree count as equal."""

CONSTANTS = {
    "sigma_s": SIGMA_S,
    "sigma_r": SIGMA_R,
    "ring": RING,
    "context_steps": CONTEXT_STEPS,
    "reach_sigma_r": REACH_SIGMA_R,
    "reach_passes": REACH_PASSES,
    "near_passes": NEAR_PASSES,
    "smooth_passes": SMOOTH_PASSES,
    "near_smooth_passes": NEAR_SMOOTH_PASSES,
    "smooth_sigma_r": SMOOTH_SIGMA_R,
    "floor": FLOOR,
}
"""What stands behind the names of DESCRIPTORS: weights serve these numbers alone."""

Stack = NDArray[np.float32]
"""(m, k, 3) float32: k filtered unit normals of each of m faces."""


def bilateral_stack(mesh: Mesh) -> Stack:
    """B-FND: the normal of each face, and that normal after one bilateral pass for each σ_s and σ_r.

    Returns
    -------
    (m, 1 + 10, 3) : the face normal first, then σ_r ascending within σ_s ascending
    """
    guides = np.broadcast_to(mesh.normals, (len(SIGMA_S), *mesh.normals.shape))
    return np.concatenate(
        [
            mesh.normals[:, None].astype(np.float32),
            _filtered(mesh, guides, SIGMA_R),
        ],
        axis=1,
    )


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


class Filters(NamedTuple):
    """What goes over a mesh many times: `reaching_stack` and `smoothed_normals`, or the same on a GPU."""

    reaching: Callable[..., Stack]
    smoothed: Callable[..., Stack]


FILTERS = Filters(reaching_stack, smoothed_normals)
"""Those of the processor."""


def _first(mesh: Mesh, noisy: Mesh, filters: Filters) -> list[Stack]:
    reach = filters.reaching(mesh, REACH_PASSES)
    return [reach, filters.smoothed(mesh, reach[:, STEADY], SMOOTH_PASSES)]


def _later(mesh: Mesh, noisy: Mesh, filters: Filters) -> list[Stack]:
    """Filter what the stage before left; and smooth the noisy mesh along its normals, so that detail can come back."""
    reach = filters.reaching(mesh, NEAR_PASSES)
    smoothed = filters.smoothed(mesh, reach[:, STEADY], NEAR_SMOOTH_PASSES)
    return [reach, smoothed, filters.smoothed(noisy, mesh.normals, NEAR_SMOOTH_PASSES, sigma_r=SMOOTH_SIGMA_R)]


DESCRIPTORS: dict[str, Callable[[Mesh, Mesh, Filters], list[Stack]]] = {
    "B": lambda mesh, noisy, filters: [bilateral_stack(mesh)],
    "B+G": lambda mesh, noisy, filters: [guided_stack(mesh)],
    "reach": lambda mesh, noisy, filters: [filters.reaching(mesh, REACH_PASSES)],
    "reach+smooth": _first,
    "near": lambda mesh, noisy, filters: [filters.reaching(mesh, NEAR_PASSES)],
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
    parallel_for(len(stack), _pair_range, np.ascontiguousarray(stack), out)
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
        then the mean parallel_for the connected part of the mesh
    """
    rings, kept, whole = mesh.topology.face_rings(1), [], part_means(values, mesh)
    spare = np.empty_like(values)
    for rounds in np.diff(CONTEXT_STEPS, prepend=0):
        kept.append(np.empty_like(values))
        for left in range(rounds - 1, -1, -1):
            after = spare if left % 2 else kept[-1]
            parallel_for(len(values), _mean_range, values, rings.indptr, rings.indices, after)
            values = after
    return [*kept, whole]


def part_means(values: NDArray[np.float32], mesh: Mesh) -> NDArray[np.float32]:
    """Average numbers, one row a face, over all that is connected with the face, (m, p)."""
    part = mesh.topology.face_components
    sizes = np.maximum(np.bincount(part), 1)
    return np.asarray((scatter_add(part, values, len(sizes)) / sizes[:, None]).astype(np.float32)[part])


def openness(mesh: Mesh) -> NDArray[np.float32]:
    """Return how far the connected part of each face is from closed, |Σ A n| / Σ A.

    What a depth camera sees from one side has other errors than a closed surface, whose fine detail they resemble.

    Returns
    -------
    (m,), from 0 where the part is closed to 1 where it is a flat sheet
    """
    part = mesh.topology.face_components
    sums = scatter_add(part, mesh.area_vectors, int(part.max(initial=-1)) + 1)
    areas = np.maximum(scatter_add(part, mesh.areas, len(sums)), np.finfo(float).tiny)
    return np.asarray((np.linalg.norm(sums, axis=1) / areas)[part], np.float32)


def _filtered(mesh: Mesh, guides: Vectors, sigma_r: tuple[float, ...]) -> Stack:
    return filtered_normals(mesh, guides, sigma_s=SIGMA_S, sigma_r=sigma_r, rings=RING)


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
    count = stack.shape[1]
    axes = np.empty((3, count), np.float32)  # in each of which the later normals are neighbours
    for f in range(start, stop):
        for i in range(count):
            for d in range(3):
                axes[d, i] = stack[f, i, d]
        p = 0
        for i in range(count):
            later = count - 1 - i
            x0, y0, z0 = axes[0, i], axes[1, i], axes[2, i]
            xs, ys, zs, row = axes[0, i + 1 :], axes[1, i + 1 :], axes[2, i + 1 :], out[f, p : p + later]
            for j in range(later):
                x, y, z = x0 - xs[j], y0 - ys[j], z0 - zs[j]
                row[j] = np.float32(0.5) * (x * x + y * y + z * z) + np.float32(FLOOR)
            p += later
