"""Screened Poisson reconstructions from noisy oriented points."""

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.sparse.linalg import LinearOperator, cg

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.lattice import grid, trilinear
from cascadenorm.data_gen.meshing.polygonise import gradients, onto_surface
from cascadenorm.data_gen.meshing.surface import Extent, disentangled
from cascadenorm.data_gen.scanning.measured import Measured, beneath
from cascadenorm.data_gen.scanning.volumes import volume_surface
from cascadenorm.data_gen.shapes.fields import DistanceField, Values
from cascadenorm.data_gen.shapes.placement import random_direction
from cascadenorm.mesh import Mesh, Vectors, one_blas_thread, unit

CELLS = 2.3  # faces of marching cubes per area of a cell's side
MARGIN_CELLS = 6  # cells around the shape
OUTLIER_POINTS = 0.01  # largest share of outliers among the points
SOLVER_ROUNDS = 12  # iterations of conjugate gradients
STIFFNESS = 0.05  # weight of a point in the system at screening 1
FEWEST_POINTS, MOST_POINTS = 1_500, 60_000  # numbers of points
SPARSEST, DENSEST = 0.1, 4.0  # points per two faces: at the least one point for 20 faces
NOISIER = 0.3  # share of the point clouds whose error is up to twice the level


def reconstruction(
    field: DistanceField, extent: Extent, *, faces: int, level: float, rng: np.random.Generator
) -> Measured:
    """Reconstruct a shape from points with errors in position and normal, including outliers, with about `faces` faces.

    The level is the deviation of the points along the normals, in mean distances between points. Raises UnfitShapeError
    if the points do not define a closed surface.
    """
    cell = float(np.sqrt(CELLS * extent.area / faces))
    density = np.exp(rng.uniform(np.log(SPARSEST), np.log(DENSEST)))
    count = int(np.clip(0.5 * faces * density, FEWEST_POINTS, MOST_POINTS))
    if rng.random() < NOISIER:
        level *= float(rng.uniform(1, 2))
    points, normals = sampled_points(field, extent.rough, count=count, level=level, size=cell, rng=rng)
    half = 0.5 * (extent.upper - extent.lower) + MARGIN_CELLS * cell
    nodes = grid(half, np.full(3, cell)) + extent.middle
    screening = float(np.exp(rng.uniform(np.log(0.2), np.log(10))))
    gap = float(np.sqrt(extent.area / count) / cell)  # distance between points, in cells
    width = max(0.6, gap * rng.uniform(0.4, 1.0))
    volume = poisson(nodes, points, normals, cell=cell, screening=screening, width=width)
    mesh = volume_surface(volume)
    placed = disentangled(Mesh(nodes[0, 0, 0] + cell * mesh.vertices, mesh.faces))
    measured = beneath(field, placed, cell=cell)
    if (np.abs(measured.normals).max(axis=1) == 0).mean() > 0.2:
        raise UnfitShapeError("too much of the reconstruction is not near the shape")
    return measured


def sampled_points(
    field: DistanceField, rough: Mesh, *, count: int, level: float, size: float, rng: np.random.Generator
) -> tuple[Vectors, Vectors]:
    """Draw points on a shape with uneven density, errors along the normals, and some outliers, as scanners do.

    Returns (n, 3) points and (n, 3) unit normals that err by up to about 20 degrees.
    """
    axis = random_direction(rng=rng)
    density = np.exp(rng.uniform(0, 1.2) * (rough.face_normals @ axis))  # one side is seen better
    weights = rough.areas * density
    face = rng.choice(len(weights), count, p=weights / weights.sum())
    weight = rng.dirichlet(np.ones(3), count)
    points = np.einsum("nk,nkd->nd", weight, rough.vertices[rough.faces[face]])
    points = onto_surface(field, points, size=size, steps=6)
    normals = unit(gradients(field, points, step=1e-3 * size))
    gap = np.sqrt(rough.area / count)
    points = points + (level * gap * rng.normal(size=count))[:, None] * normals
    normals = unit(normals + rng.uniform(0, 0.35) * rng.normal(size=normals.shape))
    astray = rng.random(count) < OUTLIER_POINTS * rng.random()
    points[astray] += 3 * gap * rng.normal(size=(int(astray.sum()), 3))
    return points, normals


def poisson(
    nodes: NDArray[np.float64], points: Vectors, normals: Vectors, *, cell: float, screening: float, width: float
) -> NDArray[np.float64]:
    """Solve for the indicator whose gradient is the field of normals (Kazhdan, Hoppe 2013), on a regular grid.

    It minimises ∫ |∇χ - V|² + screening · Σ χ(p)². V are the outward normals, (n, 3), spread over the cells around
    their points by a kernel with the deviation `width`, in cells. The second sum draws the surface χ = 0 to the points.
    Conjugate gradients solve the normal equations, preconditioned by the Laplacian, which the Fourier transform
    inverts. Returns values at the nodes (p, q, r, 3), which are `cell` apart: (p, q, r), above 0.5 inside.
    """
    shape = nodes.shape[:3]
    interpolation = trilinear((points - nodes[0, 0, 0]) / cell, shape)
    waves = [2 * np.pi * fft.fftfreq(n) for n in shape[:2]] + [2 * np.pi * fft.rfftfreq(shape[2])]
    waves = [wave.reshape([-1 if d == k else 1 for d in range(3)]) for k, wave in enumerate(waves)]
    squares = waves[0] ** 2 + waves[1] ** 2 + waves[2] ** 2
    kernel = np.exp(-0.5 * width**2 * squares)

    def transformed(values: Values) -> NDArray[np.complex128]:
        return np.asarray(fft.rfftn(values.reshape(shape)))

    def inverse(transform: NDArray[np.complex128]) -> Values:
        return np.asarray(fft.irfftn(transform, shape).ravel())

    # Each point stands for the same area, so that dense regions have no larger weight.
    density = inverse(kernel * transformed(interpolation.T @ np.ones(len(points))))
    share = 1 / np.maximum(interpolation @ density, 1e-9)

    # V is spread over a layer √(2π) · width thick, across which it integrates to one. Its divergence is the right-hand
    # side.
    divergence = np.zeros(squares.shape, np.complex128)
    for k, wave in enumerate(waves):
        divergence += 1j * wave * kernel * transformed(interpolation.T @ (-share * normals[:, k]))
    right = -inverse(divergence / (np.sqrt(2 * np.pi) * width))

    pull = STIFFNESS * screening * share / share.mean()

    def applied(values: Values) -> Values:
        pulled = interpolation.T @ (pull * (interpolation @ values))
        return np.asarray(inverse(squares * transformed(values)) + pulled)

    def conditioned(values: Values) -> Values:
        return inverse(transformed(values) / (squares + STIFFNESS))

    system, conditioner = (LinearOperator((right.size,) * 2, apply, dtype=float) for apply in (applied, conditioned))
    with one_blas_thread():
        solution, _ = cg(system, right, rtol=0, maxiter=SOLVER_ROUNDS, M=conditioner)
    return np.asarray(0.5 + (solution - np.median(interpolation @ solution)).reshape(shape))
