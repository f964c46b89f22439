"""Marching tetrahedra, by which neural reconstructions mesh a distance field."""

from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from cascadenorm.data_gen.meshing.surface import Extent, UnfitShapeError
from cascadenorm.data_gen.scanning.measured import Measured
from cascadenorm.data_gen.scanning.volumes import Volume, measured_surface, random_lattice, sampled
from cascadenorm.data_gen.shapes.fields import DistanceField
from cascadenorm.mesh import Mesh

FACES_PER_VOXEL_SIDE = 8.9  # faces of marching tetrahedra per area of a voxel's side
GRAIN = 0.0, 1.0  # voxels over which the error of the distances is spread
CUTS = {1: ((0, 1), (0, 2), (0, 3)), 3: ((3, 0), (3, 2), (3, 1))}
"""Edges cut where one or three corners of a tetrahedron lie inside. Corners inside come first."""
QUADRILATERAL = ((0, 2), (0, 3), (1, 3), (1, 2))
"""Edges cut where two corners lie inside, in order around the quadrilateral."""


def tetrahedral_surface(
    field: DistanceField, extent: Extent, *, faces: int, level: float, rng: np.random.Generator
) -> Measured:
    """Mesh a distance field with errors at the nodes of a lattice by marching tetrahedra, with about `faces` faces.

    The level is the standard deviation of the error of the distances, in thirds of a voxel. Raises UnfitShapeError if
    the field has no surface in the volume.
    """
    voxel = float(np.sqrt(FACES_PER_VOXEL_SIDE * extent.area / faces))
    nodes, axes = random_lattice(extent, np.full(3, voxel), rng=rng)
    distance = sampled(field, nodes) / voxel
    grain = gaussian_filter(rng.normal(size=distance.shape), rng.uniform(*GRAIN))
    mesh = marching_tetrahedra(0.5 - distance + level / 3 * grain / grain.std())
    return measured_surface(field, mesh, nodes, axes, cell=voxel, kept=1.0, rng=rng)


def marching_tetrahedra(volume: Volume) -> Mesh:
    """Mesh the level 0.5 of a volume, (p, q, r), with each cell cut into six tetrahedra (Doi, Koide 1991).

    The mesh is in units of voxels. Normals point to lower values.
    """
    numbers = np.arange(volume.size).reshape(volume.shape)
    values = volume.ravel()
    corners = np.concatenate([_tetrahedra(numbers, order) for order in permutations(range(3))])
    inside = values[corners] > 0.5
    counts = inside.sum(axis=1)
    cut = (counts > 0) & (counts < 4)
    corners, inside, counts = corners[cut], inside[cut], counts[cut]
    if len(corners) == 0:
        raise UnfitShapeError("the volume has no surface")
    corners = np.take_along_axis(corners, np.argsort(~inside, axis=1, kind="stable"), axis=1)
    edges = [corners[counts == count][:, np.array(cuts)] for count, cuts in CUTS.items()]
    around = corners[counts == 2][:, np.array(QUADRILATERAL)]
    edges += [around[:, [0, 1, 2]], around[:, [0, 2, 3]]]
    sides = np.sort(np.concatenate(edges), axis=2)
    unique, faces = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    low, high = (np.stack(np.unravel_index(ends, volume.shape), axis=1).astype(np.float64) for ends in unique.T)
    share = (values[unique[:, 0]] - 0.5) / (values[unique[:, 0]] - values[unique[:, 1]])
    mesh = Mesh(low + share[:, None] * (high - low), faces.reshape(-1, 3).astype(np.int32))
    outward = np.where((values[unique[:, 0]] > 0.5)[:, None], high - low, low - high)[mesh.faces[:, 0]]
    inward = np.einsum("ij,ij->i", mesh.area_vectors, outward) < 0
    return Mesh(mesh.vertices, np.where(inward[:, None], mesh.faces[:, ::-1], mesh.faces))


def _tetrahedra(numbers: NDArray[np.int64], order: tuple[int, ...]) -> NDArray[np.int64]:
    """Return one of the six tetrahedra of each cell: the steps along the axes from its first node to its last."""
    at = np.zeros(3, int)
    corners = []
    for step in (None, *order):
        if step is not None:
            at[step] = 1
        corners.append(
            numbers[tuple(slice(start, start + size - 1) for start, size in zip(at, numbers.shape, strict=True))]
        )
    return np.stack([part.ravel() for part in corners], axis=1)
