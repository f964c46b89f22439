"""Approximate manifold harmonics of large meshes (Nasikun et al. 2018)."""

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.geometry.spectra.farthest_points import spread_samples
from cascadenorm.geometry.spectra.harmonics import Harmonics, check_count, manifold_harmonics
from cascadenorm.mesh import Csr, Floats, Ints, Mesh, Vectors, kernel, one_blas_thread, parallel_for
from cascadenorm.mesh.vectors import length, row, subtract

SAMPLES_PER_HARMONIC = 3
OVERLAP = 10.0  # mean number of local functions at a point
CROWDED = 3  # vertices per sample up to which the exact problem is solved: the local functions would be too similar
RELAXATIONS = 4  # Jacobi steps that adapt the local functions to the roughness of a noisy surface
RELAXATION = 2 / 3  # damping factor of these steps


def fast_harmonics(mesh: Mesh, count: int, *, samples: int | None = None) -> Harmonics:
    """Return approximations of the lowest eigenpairs of the cotangent Laplacian.

    The eigenproblem is restricted to the span of local functions around samples. These fall from 1 to 0 as
    1 - 3r² + 2r³ over the connected patch within their radius, and are divided by their sum. Here r is the Euclidean
    distance; the distance along edges has kinks that would increase the eigenvalues by about 10 %. A few Jacobi steps
    adapt the functions to the roughness of a noisy mesh, which would otherwise cause an error of the same size. All
    eigenvalues are overestimated, the lower half by less than 2 %; eigenvectors are M-orthonormal.
    benchmarks/speed.md compares times and errors with those of Lanczos.

    Parameters
    ----------
    mesh
        Mesh with n vertices.
    count
        Number of eigenpairs k, at most the number of samples.
    samples
        Number of samples, chosen by farthest point sampling. None uses 3 k, but at least 1,000. Every connected
        component gets a sample. If the samples are a third of the vertices or more, exact eigenpairs are computed.

    Raises
    ------
    ParameterError
        `count` is out of range.
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
    reach = max(reach, 1.1 * distances[np.isfinite(distances)].max())  # cover every vertex
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
    """Return the (n, d) local functions of the centres, normalised so that rows sum to 1."""
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
    """Return the connected patch within `reach` of each centre as row lengths, vertices and values 1 - 3r² + 2r³."""
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

        # breadth first over vertices within reach: this excludes other sheets that are close in space
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
