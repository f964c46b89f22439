"""Surfaces from volumes: stair-stepped segmentations and blurred, grainy tomograms."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.decimate import thinned
from cascadenorm.data_gen.meshing.lattice import grid
from cascadenorm.data_gen.meshing.surface import Extent, disentangled
from cascadenorm.data_gen.scanning.measured import Measured, beneath
from cascadenorm.data_gen.shapes.fields import DistanceField
from cascadenorm.data_gen.shapes.placement import random_direction, random_rotation
from cascadenorm.detection.segmentation_steps import without_voxel_faces
from cascadenorm.mesh import Mesh, Vectors, scatter_add
from cascadenorm.mesh.averages import averaged

Volume = NDArray[np.float64]  # (p, q, r), one value per voxel, above 0.5 inside

MARGIN_VOXELS = 3  # voxels around the shape
STEPPED = 3.2  # faces of marching cubes on a mask per area of a voxel's side
GREY = 2.3  # the same on grey values
NETS = 0.7  # number of faces of surface nets relative to marching cubes
TILT = 0.5, 15.0  # degrees; small angles make long, low steps on planes
VOXEL_FACES = 0.06  # share of the segmentations that consist of voxel faces
SMOOTHED = 0.1  # share of the other segmentations that are slightly smoothed, as before an export
DECIMATED = 0.15  # share of the meshes that are decimated
ENLARGED = 0.15  # share of the segmentations whose labels or distances are sampled at half the resolution


def segmentation(
    field: DistanceField, extent: Extent, *, faces: int, slices: bool, rng: np.random.Generator
) -> Measured:
    """Mesh a binary mask of the shape, whose steps are one voxel high, with about `faces` faces.

    In slices, voxels are 1.5 to 4 times as long along one axis of the lattice as along the others. Raises
    UnfitShapeError if the mask is empty.
    """
    stretch = rng.uniform(1.5, 4) if slices else 1.0
    voxel_faces = bool(rng.random() < VOXEL_FACES)
    nets, kept = (True, 1.0) if voxel_faces else _mesher(rng=rng)
    voxel = float(np.sqrt(STEPPED * (NETS if nets else 1) * extent.area / (faces / kept) / stretch**0.6))
    steps = voxel * np.array([1.0, 1.0, stretch])
    nodes, axes = random_lattice(extent, steps, rng=rng)
    volume = _mask(sampled(field, nodes) / voxel, slices=slices, rng=rng)
    if voxel_faces:
        mesh = without_voxel_faces(surface_nets(np.round(volume), centered=True))
    else:
        mesh = surface_nets(volume) if nets else volume_surface(volume)
        if rng.random() < SMOOTHED:
            mesh = mesh.moved(averaged(mesh.vertices, mesh.topology.vertex_neighbors, int(rng.integers(1, 9))))
    return measured_surface(field, mesh, nodes, axes, cell=voxel * stretch, kept=kept, rng=rng)


def _mask(distance: Volume, *, slices: bool, rng: np.random.Generator) -> Volume:
    """Label voxels by signed distances, in voxels. Some masks get ragged boundaries, uneven slices or soft steps."""
    if not slices and rng.random() < ENLARGED:
        return _enlarged(distance, binary=bool(rng.random() < 0.6))
    if rng.random() < 0.3:  # an uncertain boundary, as from a noisy image or manual segmentation
        grain = gaussian_filter(rng.normal(size=distance.shape), rng.uniform(0.5, 1.5))
        distance = distance + rng.uniform(0.1, 0.6) * grain / grain.std()
    if slices and rng.random() < 0.3:  # each slice is segmented independently
        distance = distance + rng.uniform(0.1, 0.5) * rng.normal(size=distance.shape[2])
    volume = (distance < 0).astype(np.float64)
    if rng.random() < 0.25:  # an antialiased or smoothed mask
        volume = gaussian_filter(volume, rng.uniform(0.3, 0.8, 3))
    return volume


def _enlarged(distance: Volume, *, binary: bool) -> Volume:
    """Give the eight nodes of a block one value, as in a volume upsampled from half the resolution."""
    p, q, r = (length // 2 for length in distance.shape)
    means = distance[: 2 * p, : 2 * q, : 2 * r].reshape(p, 2, q, 2, r, 2).mean(axis=(1, 3, 5))
    values = (means < 0).astype(np.float64) if binary else 0.5 - means
    return np.asarray(values.repeat(2, axis=0).repeat(2, axis=1).repeat(2, axis=2))


def tomogram(field: DistanceField, extent: Extent, *, faces: int, level: float, rng: np.random.Generator) -> Measured:
    """Mesh a level of a blurred grey volume with correlated grain; the level is its deviation in fifths of contrast."""
    stretch = float(rng.uniform(1, 2)) if rng.random() < 0.3 else 1.0
    nets, kept = _mesher(rng=rng)
    voxel = float(np.sqrt(GREY * extent.area / (faces / kept) / stretch**0.6))
    steps = voxel * np.array([1.0, 1.0, stretch])
    nodes, axes = random_lattice(extent, steps, rng=rng)
    share = np.clip(0.5 - sampled(field, nodes) / voxel, 0, 1)  # approximate share of a voxel that the shape fills
    spread = rng.uniform(0.4, 1.4)
    blurred = gaussian_filter(share, spread / np.array([1.0, 1.0, stretch]))
    grain = gaussian_filter(rng.normal(size=blurred.shape), rng.uniform(0.3, 1.3))
    volume = blurred + 0.2 * level * grain / grain.std()
    threshold = 0.5 + rng.uniform(-0.08, 0.08)
    volume -= threshold - 0.5
    mesh = surface_nets(volume) if nets else volume_surface(volume)
    return measured_surface(field, mesh, nodes, axes, cell=voxel * stretch, kept=kept, rng=rng)


def _mesher(*, rng: np.random.Generator) -> tuple[bool, float]:
    """Draw whether surface nets mesh a volume instead of marching cubes, and the share of faces that are kept."""
    nets = bool(rng.random() < 0.25)
    return nets, rng.uniform(0.3, 0.8) if rng.random() < DECIMATED else 1.0


def volume_surface(volume: Volume) -> Mesh:
    """Mesh the level 0.5 of a volume, in units of voxels. Normals point to lower values."""
    from skimage.measure import marching_cubes

    if not volume.min() < 0.5 < volume.max():
        raise UnfitShapeError("the volume has no surface")
    vertices, faces, _, _ = marching_cubes(0.5 - volume, 0.0)  # type: ignore[no-untyped-call]
    return Mesh(vertices.astype(np.float64), faces)


def surface_nets(volume: Volume, *, centered: bool = False) -> Mesh:
    """Mesh the level 0.5 with one vertex per cell and one quadrilateral per crossing (Gibson 1998), in units of voxels.

    Each vertex is the mean of the crossings on the edges of its cell. Centered vertices are the centres of their cells,
    so that the quadrilaterals are voxel faces.
    """
    inside = volume > 0.5
    shape = tuple(side - 1 for side in volume.shape)  # numbers of cells
    cells, places, turned = [], [], []
    for axis in range(3):
        ends = np.moveaxis(volume, axis, 0)
        crossed = np.moveaxis(np.diff(np.moveaxis(inside, axis, 0), axis=0), 0, axis)
        node = np.argwhere(crossed)
        low, high = (np.moveaxis(values, 0, axis)[crossed] for values in (ends[:-1], ends[1:]))
        place = node.astype(np.float64)
        place[:, axis] += (0.5 - low) / (high - low)
        around = node - np.insert(list(np.ndindex(2, 2)), axis, 0, axis=1)[:, None]  # the four cells at each crossing
        if around.min(initial=0) < 0 or (around >= shape).any():
            raise UnfitShapeError("the shape reaches the border of the volume")
        cells.append(np.ravel_multi_index(tuple(np.moveaxis(around, -1, 0)), shape))
        places.append(np.tile(place, (4, 1)))
        turned.append((low > high) ^ (axis == 1))  # (x, z) about y is a left-handed pair
    used, vertex = np.unique(np.concatenate([some.ravel() for some in cells]), return_inverse=True)
    if not len(used):
        raise UnfitShapeError("the volume has no surface")
    if centered:
        vertices = np.stack(np.unravel_index(used, shape), axis=1) + 0.5
    else:
        vertices = scatter_add(vertex, np.concatenate(places), len(used)) / np.bincount(vertex)[:, None]
    triangles = []
    starts = np.cumsum([some.size for some in cells])[:-1]
    for numbers, flipped in zip(np.split(vertex.ravel(), starts), turned, strict=True):
        quads = numbers.reshape(4, -1).T[:, [0, 2, 3, 1]]
        quads[~flipped] = quads[~flipped][:, ::-1]
        a, b, c, d = (vertices[quads[:, k]] for k in range(4))
        shorter = np.linalg.norm(a - c, axis=1) <= np.linalg.norm(b - d, axis=1)
        quads = np.where(shorter[:, None], quads, np.roll(quads, -1, axis=1))
        triangles += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return Mesh(vertices, np.concatenate(triangles).astype(np.int32))


def random_lattice(extent: Extent, steps: NDArray[np.float64], *, rng: np.random.Generator) -> tuple[Volume, Vectors]:
    """Return the nodes (p, q, r, 3) of a randomly rotated and shifted lattice, and its three edges as rows."""
    turn = _orientation(rng=rng)
    half = np.abs(turn.T) @ (0.5 * (extent.upper - extent.lower)) + MARGIN_VOXELS * steps
    middle = extent.middle + turn @ (rng.uniform(-0.5, 0.5, 3) * steps)
    return grid(half, steps) @ turn.T + middle, (turn * steps).T


def _orientation(*, rng: np.random.Generator) -> Vectors:
    """Draw the rotation of a lattice: any, none, or a slight one, as of a part placed in a scanner by hand."""
    chance = rng.random()
    if chance < 0.35:
        return random_rotation(rng=rng)
    tilt = float(np.exp(rng.uniform(*np.log(TILT)))) if chance < 0.8 else 0.0
    return np.asarray(Rotation.from_rotvec(tilt * random_direction(rng=rng), degrees=True).as_matrix())


def sampled(field: DistanceField, nodes: NDArray[np.float64]) -> Volume:
    """Return the values of a field at nodes, (p, q, r)."""
    return field(nodes.reshape(-1, 3)).reshape(nodes.shape[:3])


def measured_surface(
    field: DistanceField,
    mesh: Mesh,
    nodes: NDArray[np.float64],
    axes: Vectors,
    *,
    cell: float,
    kept: float,
    rng: np.random.Generator,
) -> Measured:
    """Place a mesh in units of voxels on its lattice, drop islands, decimate it, and find its ground truth."""
    placed = disentangled(Mesh(nodes[0, 0, 0] + mesh.vertices @ axes, mesh.faces))
    if kept < 1:
        evenness = float(10 ** rng.uniform(-4, -1))
        placed = thinned(placed, faces=round(kept * len(placed.faces)), evenness=evenness)
    return beneath(field, placed, cell=cell)
