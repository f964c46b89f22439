"""Approximate manifold harmonics of large meshes (Nasikun et al. 2018)."""

import numpy as np
import scipy

from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.geometry.neighborhoods import within
from cascadenorm.geometry.spectra.farthest_points import spread_samples
from cascadenorm.geometry.spectra.harmonics import Harmonics, checked_count, manifold_harmonics
from cascadenorm.mesh import Csr, Ints, Mesh, in_frame, one_blas_thread, surface_of
from cascadenorm.registry import checked_number

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

    Returns
    -------
    k pairs: eigenvalues (k,) ascending in 1 / length², eigenvectors (n, k), and the masses of the vertices, (n,).

    Raises
    ------
    ParameterError
        `count` is out of range, or `samples` is less than `count`.
    """
    mesh, exponent = in_frame(surface_of(mesh))
    laplacian = cotangent_laplacian(mesh)
    available = int((laplacian.mass > 0).sum())
    count = checked_count(count, available)
    usual = max(SAMPLES_PER_HARMONIC * count, 1000)
    wanted = usual if samples is None else checked_number("samples", int, samples, minimum=count)
    if CROWDED * wanted >= available:
        return manifold_harmonics(mesh, count).scaled(exponent)
    centers, distances = spread_samples(mesh, wanted, first=int(np.argmax(laplacian.mass > 0)))
    checked_count(count, len(centers))
    reach = np.sqrt(OVERLAP * laplacian.mass.sum() / (np.pi * len(centers)))
    reach = max(reach, 1.1 * distances[np.isfinite(distances)].max())  # cover every vertex
    basis = _local_functions(mesh, centers, reach)
    diagonal = laplacian.stiffness.diagonal()
    weights = np.divide(RELAXATION, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0)
    for _ in range(RELAXATIONS):
        basis = scipy.sparse.csr_array(basis - scipy.sparse.diags_array(weights) @ (laplacian.stiffness @ basis))
    stiffness = (basis.T @ (laplacian.stiffness @ basis)).toarray()
    mass = (basis.T @ (scipy.sparse.diags_array(laplacian.mass) @ basis)).toarray()
    with one_blas_thread(scipy.linalg):
        values, reduced = scipy.linalg.eigh(stiffness, mass, subset_by_index=(0, count - 1))
    return Harmonics(np.maximum(values, 0.0), np.asarray(basis @ reduced), laplacian.mass).scaled(exponent)


def _local_functions(mesh: Mesh, centers: Ints, reach: float) -> "scipy.sparse.csr_array":
    """Return the (n, d) local functions of the centres, normalised so that rows sum to 1."""
    n, count = len(mesh.vertices), len(centers)
    positions, seeds = mesh.vertices[centers], Csr(np.arange(count + 1), centers.astype(np.int32))
    near = within(positions, np.full(count, reach), mesh.vertices, mesh.topology.vertex_neighbors, seeds)
    rows, columns = near.indices, near.rows
    r = np.linalg.norm(mesh.vertices[rows] - positions[columns], axis=1) / reach
    values = 1 - 3 * r**2 + 2 * r**3
    functions = scipy.sparse.csr_array(scipy.sparse.coo_array((values, (rows, columns)), (n, count)))
    total = functions.sum(axis=1)
    return scipy.sparse.csr_array(
        scipy.sparse.diags_array(np.divide(1, total, out=np.zeros(n), where=total > 0)) @ functions
    )
