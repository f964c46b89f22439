"""Approximate manifold harmonics of large meshes, from a few thousand local functions (Nasikun et al. 2018)."""

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.geometry.spectra.farthest_points import spread_samples
from cascadenorm.geometry.spectra.harmonics import Harmonics, check_count, manifold_harmonics
from cascadenorm.mesh import Csr, Floats, Ints, Mesh, Vectors, kernel, one_blas_thread, parallel_for
from cascadenorm.mesh.vectors import length, row, subtract

SAMPLES_PER_HARMONIC = 3
OVERLAP = 10.0  # how many local functions reach a point, on average
CROWDED = 3  # vertices a sample up to which local functions are too alike, and the exact problem is small enough
RELAXATIONS = 4  # Jacobi steps that fit the local functions to the roughness of a noisy surface
RELAXATION = 2 / 3  # their size


def fast_harmonics(mesh: Mesh, count: int, *, samples: int | None = None) -> Harmonics:
    """Return about the lowest eigenpairs of the cotangent Laplacian.

    Functions around samples fall from 1 to 0 as 1 - 3r² + 2r³, over the patch that is connected within their reach;
    they are divided by their sum, and the eigenproblem is solved among their combinations. r is the distance in
    space: that along edges has kinks, which alone raise the eigenvalues by a tenth. A few Jacobi steps on the functions
    fit them to the roughness of a noisy mesh, which else costs as much. All eigenvalues are overestimated, the lower
    half by less than 2 %; eigenvectors are M-orthonormal. benchmarks/speed.md has times and errors beside Lanczos.

    Parameters
    ----------
    mesh
        n vertices.
    count
        k, at most the number of samples.
    samples
        How many, spread by farthest points; None: 3 k, at least 1,000. Every connected part gets one; with a third of
        the vertices or more the pairs are exact instead.

    Raises
    ------
    ParameterError
        Count is out of range.
    """
    laplacian = cotangent_laplacian(mesh)
    available = int((laplacian.mass > 0).sum())
    wanted = max(SAMPLES_PER_HARMONIC * count, 1000) if samples is None else samples
    check_count(count, min(wanted, available))
    if CROWDED * wanted >= available:
        return manifold_harmonics(mesh, count)
    centers, distances = spread_samples(mesh, wanted, first=int(np.argmax(laplacian.mass > 0)))
    check_count(count, len(centers))
    reach = np.sqrt(OVERLAP * laplacian.mass.sum() / (np.pi * len(centers)))
    reach = max(reach, 1.1 * distances[np.isfinite(distances)].max())  # so that every vertex is reached
    basis = _local_functions(mesh, centers, reach)
    diagonal = laplacian.stiffness.diagonal()
    weights = np.divide(RELAXATION, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0)
    for _ in range(RELAXATIONS):
        basis = scipy.sparse.csr_array(basis - scipy.sparse.diags_array(weights) @ (laplacian.stiffness @ basis))
    stiffness = (basis.T @ (laplacian.stiffness @ basis)).toarray()
    mass = (basis.T @ (scipy.sparse.diags_array(laplacian.mass) @ basis)).toarray()
    with one_blas_thread():
        values, reduced = scipy.linalg.eigh(stiffness, mass, subset_by_index=(0, count - 1))
    return Harmonics(np.maximum(values, 0.0), np.asarray(basis @ reduced), laplacian.mass)


def _local_functions(mesh: Mesh, centers: NDArray[np.int64], reach: float) -> "scipy.sparse.csr_array":
    """Return (n, d) the local function of each centre, rows divided by their sum."""
    neighbors, n = mesh.topology.vertex_neighbors, len(mesh.vertices)
    parts = parallel_for(len(centers), _local_range, neighbors, mesh.vertices, centers, reach, smallest=16)
    counts = np.concatenate([counts for counts, _, _ in parts])
    rows = np.concatenate([found for _, found, _ in parts])
    values = np.concatenate([weights for _, _, weights in parts])
    columns = np.repeat(np.arange(len(centers)), counts)
    functions = scipy.sparse.csr_array(scipy.sparse.coo_array((values, (rows, columns)), (n, len(centers))))
    total = functions.sum(axis=1)
    return scipy.sparse.csr_array(
        scipy.sparse.diags_array(np.divide(1, total, out=np.zeros(n), where=total > 0)) @ functions
    )


@kernel
def _local_range(
    start: int, stop: int, neighbors: Csr, positions: Vectors, centers: Ints, reach: float
) -> tuple[Ints, Ints, Floats]:
    """Vertices of the connected patch within reach of each centre, and 1 - 3r² + 2r³ there, row after row."""
    seen = np.full(len(neighbors.indptr) - 1, -1, np.int64)
    counts = np.zeros(stop - start, np.int64)
    found, weights = np.empty(1024, np.int64), np.empty(1024)
    end = 0
    for c in range(start, stop):
        center = centers[c]
        first, next_one = end, end
        if end == len(found):
            found, weights = np.concatenate((found, found)), np.concatenate((weights, weights))
        # the centre itself, with weight 1
        seen[center] = c
        found[end], weights[end] = center, 1.0
        end += 1

        # breadth first from there, over vertices within reach alone: what another sheet brings near stays out
        while next_one < end:
            i = found[next_one]
            next_one += 1
            for k in range(neighbors.indptr[i], neighbors.indptr[i + 1]):
                j = neighbors.indices[k]
                if seen[j] == c:
                    continue
                seen[j] = c
                r = length(subtract(row(positions, j), row(positions, center))) / reach
                if r >= 1:
                    continue
                if end == len(found):
                    found, weights = np.concatenate((found, found)), np.concatenate((weights, weights))
                found[end], weights[end] = j, 1.0 - 3.0 * r * r + 2.0 * r * r * r
                end += 1
        counts[c - start] = end - first
    return counts, found[:end].copy(), weights[:end].copy()
