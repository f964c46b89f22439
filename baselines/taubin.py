"""Taubin's λ|μ smoothing: a low-pass filter that does not shrink (Taubin 1995)."""

from typing import Annotated

import numpy as np

from cascadenorm.baselines.diffusion import Moving
from cascadenorm.execution.progress import track
from cascadenorm.mesh import Bools, Csr, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.vectors import row, scaled, subtract
from cascadenorm.registry import Parameter, ParameterError, method

LARGEST_GROWTH = 10.0


@method("taubin", source="Taubin 1995", family="smoothing", rings=lambda given, _: 2 * given["iterations"])
def taubin(
    mesh: Mesh,
    *,
    step: Annotated[float, Parameter("λ, step size of the shrinking step", above=0, maximum=1)] = 0.5,
    pass_band: Annotated[float, Parameter("Pass-band eigenvalue k_PB, kept unchanged", above=0, below=2)] = 0.1,
    iterations: Annotated[int, Parameter("Number of pairs of steps λ and μ", minimum=0)] = 30,
    region: Moving = None,
) -> Vectors:
    """Alternate steps λ > 0 and μ < 0 with the uniform Laplacian, so that frequencies below the pass band nearly stay.

    The eigenvectors of the Laplacian, with eigenvalues k from 0 to 2, are scaled by ((1 - λk)(1 - μk))^iterations,
    where 1/λ + 1/μ = k_PB; in the middle of the pass band, they grow by 1 - λμ k_PB²/4 in each iteration, and at most
    tenfold in total. Vertices outside the region and those without a face do not move.

    Formula
    -------
    x ← x - λLx, then x ← x - μLx;   L = 1 - D⁻¹W, the uniform Laplacian;   1/λ + 1/μ = k_PB
    transfer: ((1 - λk)(1 - μk))^iterations of each eigenvector with eigenvalue k

    Limits
    ------
    Edges and corners are rounded. A pass band suits one edge length: uneven meshes are smoothed unevenly.
    """
    mu = opposite_step(step, pass_band)
    with np.errstate(over="ignore"):
        growth = np.float64(1 - step * mu * pass_band**2 / 4) ** iterations
    if growth > LARGEST_GROWTH:
        raise ParameterError(
            f"step {step:g} and pass_band {pass_band:g} multiply frequencies within the pass band by {growth:.3g} in "
            f"{iterations} iterations: take a smaller pass band, or fewer iterations"
        )
    neighbors = mesh.topology.vertex_neighbors
    free = np.ones(len(mesh.vertices), bool) if region is None else region
    vertices, after = mesh.vertices.copy(), np.empty_like(mesh.vertices)
    for _ in track(iterations):
        for size in (step, mu):
            parallel_for(len(vertices), _step_range, neighbors, free, size, vertices, after)
            vertices, after = after, vertices
    return vertices


@kernel
def _step_range(
    start: int, stop: int, neighbors: Csr, free: Bools, size: float, vertices: Vectors, after: Vectors
) -> None:
    """Take a step with the uniform Laplacian; products of sparse matrices take over twice as long."""
    for i in range(start, stop):
        x = y = z = 0.0
        k, last = neighbors.indptr[i], neighbors.indptr[i + 1]
        count = float(last - k)
        if free[i] and count > 0:
            # the vertex itself is added between its neighbours, in the order of a row of the matrix
            while k < last and neighbors.indices[k] < i:
                x, y, z = subtract((x, y, z), row(vertices, neighbors.indices[k]))
                k += 1
            x, y, z = x + count * vertices[i, 0], y + count * vertices[i, 1], z + count * vertices[i, 2]
            while k < last:
                x, y, z = subtract((x, y, z), row(vertices, neighbors.indices[k]))
                k += 1
            x, y, z = scaled(size, scaled(1.0 / count, (x, y, z)))
        after[i, 0], after[i, 1], after[i, 2] = vertices[i, 0] - x, vertices[i, 1] - y, vertices[i, 2] - z


def opposite_step(step: float, pass_band: float) -> float:
    """Return μ = 1 / (k_PB - 1/λ).

    Raises ParameterError if μ is not negative, or if the highest frequency (k = 2) grows: |(1 - 2λ)(1 - 2μ)| > 1.
    """
    if step * pass_band >= 1:
        raise ParameterError(
            f"step {step:g} and pass_band {pass_band:g} give no negative μ: their product must be below 1"
        )
    mu = 1 / (pass_band - 1 / step)
    growth = (1 - 2 * step) * (1 - 2 * mu)
    if abs(growth) > 1:
        raise ParameterError(
            f"step {step:g} and pass_band {pass_band:g} (μ = {mu:.3g}) multiply the highest frequency by {growth:.3g} "
            "in every iteration, which must stay within -1 … 1: take a smaller step; 0.5 always does"
        )
    return mu
