"""Steps of volumes that were enlarged by nearest neighbour, which repeat every few voxels."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.detection.voxel_lattice import SAME_VECTOR, VoxelLattice, lattice_of_mask
from cascadenorm.mesh import Floats, Ints, Mesh, Vectors, part_of

FEWEST_VERTICES = 200
"""Vertices of a component of which fewer do not tell how it was made."""
FEWEST_LAYERS = 4
"""Layers of voxels across each axis in which the surface has to have steps; a box lies in two."""
COVERED_VERTICES = 0.95
"""Share of the vertices on edges of the lattice along each axis that lie in these layers."""
ON_EDGES = 0.85
"""Share of the vertices that lie on edges of the lattice away from its nodes; a few grey values are near the level."""
CLOSE = 0.02
"""Voxels, within which a vertex lies on a plane of nodes."""
ERROR_WIDTH = 2.0
"""Width of the error, in steps: a tread and the rise beside it."""


def enlarged_steps(mesh: Mesh) -> Floats:
    """Find the width of the steps on each connected component that comes from an enlarged volume.

    Where each voxel of a mask, or of a grey volume, was repeated k times along each axis, its value changes at every
    k-th plane between voxels alone. So on the finer lattice all vertices lie in every k-th layer of cells.

    Parameters
    ----------
    mesh
        Mesh with c connected components.

    Returns
    -------
    (c,) widths in the unit of the mesh; 0 for components without such steps.
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
    """Return how often each voxel was repeated along each axis; 0 for once."""
    lattice = lattice_of_mask(mesh)
    lattice = _lattice_along_axes(mesh) if lattice is None else lattice
    if lattice is None:
        return 0
    points = mesh.vertices[mesh.topology.used_vertices]
    cells = _cells(points, lattice)
    if sum(map(len, cells)) < ON_EDGES * len(points):
        return 0
    factors = {_period(along) for along in cells}
    return factors.pop() if len(factors) == 1 else 0


def _lattice_along_axes(mesh: Mesh) -> VoxelLattice | None:
    """Return the lattice whose spacing along each axis is the step that most edges make; None where one makes none.

    Edges on the treads of an enlarged volume join parallel edges of the lattice, one spacing apart.
    """
    edge, ends = mesh.mean_edge_length, mesh.topology.edges
    steps = np.abs(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]])
    spacings = []
    for along in steps.T:
        longer = along[along > 0.1 * edge]
        _, cell, counts = np.unique(np.round(longer / (SAME_VECTOR * edge)), return_inverse=True, return_counts=True)
        if not len(longer):
            return None
        spacings.append(longer[cell.ravel() == np.argmax(counts)].mean())
    return np.diag(np.array(spacings))


def _cells(points: Vectors, lattice: VoxelLattice) -> list[Ints]:
    """Return the layer of cells of each vertex on an edge along each axis of the lattice, for the three axes."""
    places = (points - points[0]) @ np.linalg.inv(lattice)
    for axis in range(3):
        places[:, axis] -= _nodes(places[:, axis])
    off = np.abs(places - np.round(places)) > CLOSE
    single = off.sum(axis=1) == 1
    return [np.floor(places[single & off[:, axis], axis]).astype(np.int64) for axis in range(3)]


def _nodes(places: NDArray[np.float64]) -> float:
    """Return where the planes of nodes lie between 0 and 1: where the vertices on edges along the other axes are."""
    shares = places - np.floor(places)
    near = np.round(shares / CLOSE).astype(np.int64) % round(1 / CLOSE)
    most = np.argmax(np.bincount(near)) * CLOSE
    close = (shares - most + 0.5) % 1 - 0.5
    return float(most + np.mean(close[np.abs(close) <= CLOSE]))


def _period(cells: Ints) -> int:
    """Return the distance between layers that all cells but a few lie in; 0 if it is 1 or there are few layers."""
    layers, counts = np.unique(cells, return_counts=True)
    order = np.argsort(-counts, kind="stable")
    enough = int(np.searchsorted(np.cumsum(counts[order]), COVERED_VERTICES * len(cells))) + 1
    kept = np.sort(layers[order[:enough]])
    if len(kept) < FEWEST_LAYERS:
        return 0
    period = int(np.gcd.reduce(np.diff(kept)))
    return period if period > 1 else 0
