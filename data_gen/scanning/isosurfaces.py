"""Level surfaces of distance fields, exact or with the error of a neural reconstruction."""

from collections.abc import Callable
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.polygonise import onto_surface
from cascadenorm.data_gen.meshing.surface import Extent, disentangled
from cascadenorm.data_gen.scanning.measured import Measured
from cascadenorm.data_gen.scanning.volumes import (
    Volume,
    measured_surface,
    random_lattice,
    sampled,
    surface_nets,
    volume_surface,
)
from cascadenorm.data_gen.shapes.fields import DistanceField, pushed_out
from cascadenorm.data_gen.shapes.organic import skin
from cascadenorm.data_gen.shapes.patterns import smooth_relief
from cascadenorm.mesh import Mesh

FACES_PER_VOXEL_SIDE = 8.9  # faces of marching tetrahedra per area of a voxel's side
GRAIN = 0.0, 1.0  # voxels over which the error of the distances is spread
CUTS = {1: ((0, 1), (0, 2), (0, 3)), 3: ((3, 0), (3, 2), (3, 1))}
"""Edges cut where one or three corners of a tetrahedron lie inside. Corners inside come first."""
QUADRILATERAL = ((0, 2), (0, 3), (1, 3), (1, 2))  # edges cut where two corners lie inside, in order


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
    """Mesh the level 0.5 of a volume, in voxels, with each cell cut into six tetrahedra (Doi, Koide 1991)."""
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
    steps = np.cumsum([np.zeros(3, int), *np.eye(3, dtype=int)[list(order)]], axis=0)
    cells = np.array(numbers.shape) - 1
    return np.stack([numbers[tuple(map(slice, at, at + cells))].ravel() for at in steps], axis=1)


RELIEF_SHARE = 0.85  # share of the meshes with a relief a few edges wide
SMOOTH_SHARE = 0.5  # share of the reliefs that are smooth; the others are folds, hair, scales, cracks and so on
WAVES_SHARE = 0.5  # share of the smooth reliefs that are waves instead of gradient noise
FINEST = 3.0  # shortest wavelength of the other reliefs, in mean edge lengths
EDGE = 0.88  # mean edge length in voxels, roughly
RELAXED_SHARE = 0.6  # share of the meshes whose vertices are moved onto the surface
MESHERS = {
    "cubes": (volume_surface, 3.0, 0.6),
    "nets": (surface_nets, 3.0, 0.2),
    "tetrahedra": (marching_tetrahedra, FACES_PER_VOXEL_SIDE, 0.2),
}
"""Function that meshes a volume, its number of faces per area of a voxel's side, and the share of meshes that use
it."""


def isosurface(field: DistanceField, extent: Extent, *, faces: int, rng: np.random.Generator) -> Mesh:
    """Mesh the level of an exact field, whose only error is the interpolation between the nodes of a lattice.

    Most fields get a relief. The mesh has about `faces` faces. Raises UnfitShapeError if the field has no surface in
    the volume.
    """
    mesher, density, _ = MESHERS[str(rng.choice(list(MESHERS), p=[share for *_, share in MESHERS.values()]))]
    voxel = float(np.sqrt(density * extent.area / faces))
    if rng.random() < RELIEF_SHARE:
        field = _with_relief(field, EDGE * voxel, rng)
    placed = level_surface(field, extent, mesher, voxel=voxel, rng=rng)
    return onto_level(field, placed, voxel) if rng.random() < RELAXED_SHARE else placed


def level_surface(
    field: DistanceField, extent: Extent, mesher: Callable[[Volume], Mesh], *, voxel: float, rng: np.random.Generator
) -> Mesh:
    """Mesh the level 0 of a field that is sampled at the nodes of a lattice in a random direction."""
    nodes, axes = random_lattice(extent, np.full(3, voxel), rng=rng)
    mesh = mesher(0.5 - sampled(field, nodes) / voxel)
    return disentangled(Mesh(nodes[0, 0, 0] + mesh.vertices @ axes, mesh.faces))


def onto_level(field: DistanceField, mesh: Mesh, voxel: float) -> Mesh:
    """Move the vertices of a level surface onto the level between the nodes."""
    return mesh.moved(onto_surface(field, mesh.vertices, size=0.3 * voxel))


def _with_relief(field: DistanceField, edge: float, rng: np.random.Generator) -> DistanceField:
    if rng.random() < SMOOTH_SHARE:
        relief = smooth_relief(edge=edge, waves=rng.random() < WAVES_SHARE, steep=True, rng=rng)
        return pushed_out(field, relief, amplitude=1.0)
    return skin(field, finest=FINEST * edge, layers=1, rng=rng)
