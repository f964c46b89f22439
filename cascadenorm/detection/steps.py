"""Detection of steps in volumes enlarged by nearest-neighbour interpolation and in quantised heights or depths."""

from dataclasses import dataclass

import numpy as np

from cascadenorm.detection.voxel_lattice import SAME_VECTOR, VoxelLattice, lattice_of_mask, some_edge_vectors
from cascadenorm.mesh import Floats, Ints, Mesh, Vectors, connected_components, first_of_each, pair_products, part_of

FEWEST_VERTICES = 200  # components with fewer vertices are not examined
MOST_VERTICES = 50_000  # of larger meshes, about this many vertices are examined, evenly spaced in order
FEWEST_LAYERS = 4  # smallest number of voxel layers with steps along each axis; a box has two
COVERED_VERTICES = 0.95  # smallest fraction of the vertices on lattice edges along each axis that lie in these layers
ON_EDGES = 0.85  # smallest fraction of the vertices on edges, not nodes; few grey values are near the level
CLOSE = 0.02  # distance in voxels within which a vertex lies on a plane of nodes
ERROR_WIDTH = 2.0  # width of the error in steps: a tread and the adjacent riser
FLAT = 1e-3  # largest angle in radians between the normals of adjacent faces of a tread
FEWEST_FACES = 8  # smallest number of faces of a tread; fewer may be coplanar by chance, as in marching tetrahedra
FEWEST_TREADS = 12
SHARE = 0.5  # smallest fraction of the area, without that of a base, that lies on parallel treads
PARALLEL = 1e-4  # largest 1 - cosine of the angle between the normals of parallel treads
OTHER_WAY = 0.05  # largest area of other treads that face the opposite way, relative to that of the treads
NARROWEST_STEPS = 5.0  # smallest width in mean edge lengths; `auto` removes narrower steps by itself


def enlarged_steps(mesh: Mesh) -> Floats:
    """Return the width of the steps on each of c connected components extracted from an enlarged volume.

    If each voxel of a mask or grey volume was repeated k times along each axis, values change only at every k-th plane
    between voxels. All vertices then lie in every k-th layer of cells of the enlarged lattice. The (c,) widths are in
    mesh units; 0 for components without such steps.
    """
    components = mesh.topology.components
    sizes = np.bincount(components)
    widths = np.zeros(len(sizes))
    of_faces = mesh.topology.face_components
    large = np.flatnonzero(sizes >= FEWEST_VERTICES)
    order = np.argsort(of_faces, kind="stable")
    starts = np.searchsorted(of_faces[order], [large, large + 1])
    for component, start, stop in zip(large, *starts, strict=True):
        part = mesh if len(sizes) == 1 else part_of(mesh, order[start:stop])[0]
        widths[component] = ERROR_WIDTH * enlargement(part) * part.mean_edge_length
    return widths


def enlargement(mesh: Mesh) -> int:
    """Return the number of repetitions of each voxel along each axis; 0 if the volume was not enlarged."""
    lattice = lattice_of_mask(mesh)
    lattice = _lattice_along_axes(mesh) if lattice is None else lattice
    if lattice is None:
        return 0
    points = mesh.vertices[mesh.topology.used_vertices]
    points = points[:: max(1, len(points) // MOST_VERTICES)]
    cells = _cells(points, lattice)
    if sum(map(len, cells)) < ON_EDGES * len(points):
        return 0
    factors = {_period(along) for along in cells}
    return factors.pop() if len(factors) == 1 else 0


def _lattice_along_axes(mesh: Mesh) -> VoxelLattice | None:
    """Return the axis-aligned lattice with the most frequent edge extent along each axis as its spacing, or None.

    Edges on the treads of an enlarged volume join parallel lattice edges that are one spacing apart.
    """
    edge, steps = mesh.mean_edge_length, np.abs(some_edge_vectors(mesh))
    spacings = []
    for along in steps.T:
        longer = along[along > 0.1 * edge]
        _, cell, counts = np.unique(np.round(longer / (SAME_VECTOR * edge)), return_inverse=True, return_counts=True)
        if not len(longer):
            return None
        spacings.append(longer[cell.ravel() == np.argmax(counts)].mean())
    return np.diag(np.array(spacings))


def _cells(points: Vectors, lattice: VoxelLattice) -> list[Ints]:
    """Return, for each of the three axes, the cell layers of the vertices on lattice edges along this axis."""
    places = (points - points[0]) @ np.linalg.inv(lattice)
    for axis in range(3):
        places[:, axis] -= _nodes(places[:, axis])
    off = np.abs(places - np.round(places)) > CLOSE
    single = off.sum(axis=1) == 1
    return [np.floor(places[single & off[:, axis], axis]).astype(np.int64) for axis in range(3)]


def _nodes(places: Floats) -> float:
    """Return the offset of the planes of nodes in 0 … 1, from the vertices on lattice edges along the other axes."""
    shares = places - np.floor(places)
    near = np.round(shares / CLOSE).astype(np.int64) % round(1 / CLOSE)
    most = np.argmax(np.bincount(near)) * CLOSE
    close = (shares - most + 0.5) % 1 - 0.5
    return float(most + np.mean(close[np.abs(close) <= CLOSE]))


def _period(cells: Ints) -> int:
    """Return the period of the layers that contain nearly all cells; 0 if it is 1 or there are too few layers."""
    layers, counts = np.unique(cells, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    enough = int(np.searchsorted(np.cumsum(counts[order]), COVERED_VERTICES * len(cells))) + 1
    kept = np.sort(layers[order[:enough]])
    if len(kept) < FEWEST_LAYERS:
        return 0
    period = int(np.gcd.reduce(np.diff(kept)))
    return period if period > 1 else 0


@dataclass(frozen=True, kw_only=True)
class Treads:
    """Flat, parallel treads that cover most of a mesh."""

    count: int
    width: float  # of a typical tread with its riser, in mean edge lengths


def treads(mesh: Mesh) -> Treads | None:
    """Find the steps of quantisation on a height field or depth image; return None if there are none.

    A tread is a connected set of coplanar faces. Its width is its hydraulic diameter: four times the area divided by
    the perimeter. The typical width is the area-weighted mean, so that the many small treads of steep parts have little
    weight. Heights and depths have one value at each place, so their treads face the same way. The flat faces of
    machine parts face both ways. A single one that faces the other way may be the base of a solid.
    """
    pairs = mesh.topology.face_pairs
    normals, areas = mesh.face_normals, mesh.areas
    if not mesh.mean_edge_length > 0 or not len(pairs):
        return None
    joined = pair_products(normals, pairs) > np.cos(FLAT)
    labels = connected_components(pairs[joined], len(mesh.faces))
    tread_areas = np.bincount(labels, weights=areas)
    first = first_of_each(labels)
    large = np.bincount(labels) >= FEWEST_FACES
    along = normals[first] @ normals[first[np.argmax(tread_areas)]]
    large &= np.abs(along) > 1 - PARALLEL
    one, other = large & (along > 0), large & (along < 0)
    if other.sum() > one.sum():
        one, other = other, one
    area, base = float(tread_areas[one].sum()), float(tread_areas[other].max(initial=0.0))
    if one.sum() < FEWEST_TREADS or area < SHARE * (mesh.area - base):
        return None
    if tread_areas[other].sum() - base > OTHER_WAY * area:
        return None
    ends = mesh.topology.edges[mesh.topology.interior_edges[~joined]]
    lengths = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    perimeters = np.zeros(len(one))
    for side in pairs[~joined].T:
        perimeters += np.bincount(labels[side], weights=lengths, minlength=len(one))
    kept = one & (perimeters > 0)
    if not kept.any():  # flat sheets that no step joins
        return None
    widths = 4 * tread_areas[kept] / perimeters[kept]
    width = 1 + float(np.average(widths, weights=tread_areas[kept])) / mesh.mean_edge_length
    return Treads(count=int(kept.sum()), width=width) if width >= NARROWEST_STEPS else None
