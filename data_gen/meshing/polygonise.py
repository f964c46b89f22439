"""Polygonise a field by marching cubes or dual contouring.

Both methods start from the crossings of the surface with the edges of a lattice. Marching cubes uses them as vertices.
Dual contouring puts one vertex into each sheet of surface within a cell, where the planes at the crossings of the sheet
meet (Ju et al. 2002), and one quadrilateral around each crossing, so that sharp edges become edges of the mesh. A cell
with two sheets gets two vertices (Nielson 2004), so that the result is nearly always a manifold.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.lattice import Lattice, trilinear
from cascadenorm.data_gen.shapes.fields import DistanceField, Values
from cascadenorm.mesh import Mesh, Topology, Vectors, connected_components, scatter_add, unit

FLAT_SCATTER = 0.08
"""Planes whose scatter has an eigenvalue below this share of the largest count as one plane, or one edge."""
SNAP = 0.02  # values closer to zero than this share of the spacing are moved away, so that no crossing is at a node


class Crossings(NamedTuple):
    """Points where lattice edges cross the surface, and the triangles of marching cubes over these points."""

    points: Vectors
    triangles: NDArray[np.int32]
    nodes: NDArray[np.int64]  # (n, 3) lower end of the lattice edge of each crossing
    axes: NDArray[np.int64]  # (n,) axis of that edge; -1 for the rare extra points inside a cell
    rising: NDArray[np.bool_]  # (n,) whether the field rises along the edge
    cells: NDArray[np.int64]  # (m, 3) cell of each triangle


def gradients(field: DistanceField, points: Vectors, *, step: float) -> Vectors:
    """Return the gradients by differences over a tetrahedron (four values per point)."""
    corners = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    shifted = points[None] + step * corners[:, None]
    values = field(shifted.reshape(-1, 3)).reshape(4, -1)
    return np.asarray(values.T @ corners / (4 * step))


def onto_surface(field: DistanceField, points: Vectors, *, size: float, reach: float = 1.0, steps: int = 2) -> Vectors:
    """Move points along the gradient to the zero level of the field, by at most `reach` sizes in each step.

    The size is a length that is small compared with the shape and much larger than the step of the differences.
    """
    for _ in range(steps):
        slope = gradients(field, points, step=1e-3 * size)
        square = np.maximum(np.einsum("ij,ij->i", slope, slope), 0.05)
        move = -(field(points) / square)[:, None] * slope
        length = np.linalg.norm(move, axis=1, keepdims=True)
        points = points + move * np.minimum(1, reach * size / np.maximum(length, 1e-300))
    return points


def marching_cubes(field: DistanceField, lattice: Lattice) -> Mesh:
    """Triangulate the crossings of the surface with the edges of the lattice."""
    crossings = find_crossings(field, lattice)
    return Mesh(crossings.points, crossings.triangles)


def dual_contouring(field: DistanceField, lattice: Lattice) -> Mesh:
    """Triangulate with one vertex per sheet in a cell, on an edge or corner of the shape if there is one."""
    crossings = find_crossings(field, lattice)
    sheets, count = _sheets(crossings)
    normals = unit(gradients(field, crossings.points, step=1e-4 * lattice.spacing))
    corner = np.unique(sheets[:, None] * np.int64(len(crossings.points)) + crossings.triangles)
    sheet, crossing = np.divmod(corner, len(crossings.points))
    on_edge = crossings.axes[crossing] >= 0
    sheet, crossing = sheet[on_edge], crossing[on_edge]
    vertices, _ = meeting_points(crossings.points[crossing], normals[crossing], sheet, count, reach=lattice.spacing)
    quads = _quads(crossings, sheets)
    return Mesh(vertices, _split(field, vertices, quads))


def off_nodes(values: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Move values at the nodes of a lattice away from zero, so that no crossing is at a node."""
    limit = SNAP * spacing
    return np.where(values >= 0, np.maximum(values, limit), np.minimum(values, -limit))


def find_crossings(field: DistanceField, lattice: Lattice) -> Crossings:
    """Run marching cubes on the lattice, then locate each crossing exactly on its edge."""
    from skimage.measure import marching_cubes as march

    values = lattice.values
    pushed = off_nodes(values, lattice.spacing)
    if not pushed.min() < 0 < pushed.max():
        raise UnfitShapeError("the field has one sign all over the lattice")
    clipped = np.clip(pushed, -4 * lattice.spacing, 4 * lattice.spacing)
    found, triangles, _, _ = march(clipped, 0.0)  # type: ignore[no-untyped-call]
    found = found.astype(np.float64)
    cells = np.floor(found[triangles].mean(axis=1)).astype(np.int64)

    nodes = np.floor(found).astype(np.int64)
    part = found - nodes
    inner = (part > 1e-4) & (part < 1 - 1e-4)
    axes = np.where(inner.sum(axis=1) == 1, inner.argmax(axis=1), -1)
    nodes = np.where(inner, nodes, np.round(found).astype(np.int64))
    ends = nodes + (np.arange(3) == axes[:, None])
    low, high = values[tuple(nodes.T)], values[tuple(ends.T)]
    start, stop = lattice.nodes[tuple(nodes.T)], lattice.nodes[tuple(ends.T)]
    points = start + _roots(field, start, stop, low, high)[:, None] * (stop - start)
    inside = axes < 0
    if inside.any():
        nodes_of_lattice = lattice.nodes.reshape(-1, 3)
        points[inside] = trilinear(found[inside], lattice.values.shape) @ nodes_of_lattice
    rising = low < high
    triangles = triangles if _face_upward(lattice, points[triangles], cells) else triangles[:, ::-1]
    return Crossings(points, triangles, nodes, axes, rising, cells)


def _face_upward(lattice: Lattice, corners: NDArray[np.float64], cells: NDArray[np.int64]) -> bool:
    """Whether triangles, (m, 3, 3), face the direction in which the values rise across their cells, on the whole."""
    around = tuple(np.moveaxis(cells[:, None] + np.array(list(np.ndindex(2, 2, 2))), -1, 0))  # (m, 8) nodes
    from_middle = lattice.nodes[around] - lattice.nodes[around].mean(axis=1, keepdims=True)
    rise = np.einsum("mk,mkd->md", np.sign(lattice.values[around]), from_middle)
    a, b, c = np.moveaxis(corners, 1, 0)
    return bool(np.einsum("md,md->", np.cross(b - a, c - a), rise) > 0)


def _roots(field: DistanceField, start: Vectors, stop: Vectors, low: Values, high: Values) -> Values:
    """Return the relative position between start and stop of the zero of the field, by the Illinois method."""
    share = np.clip(low / np.where(low == high, 1.0, low - high), 0, 1)
    open_ = np.flatnonzero((low < 0) != (high < 0))
    left, right, low, high = np.zeros(len(open_)), np.ones(len(open_)), low[open_], high[open_]
    side = np.zeros(len(open_), np.int8)
    for _ in range(12):
        at = share[open_]
        value = field(start[open_] + at[:, None] * (stop - start)[open_])
        lower = (value < 0) == (low < 0)
        high = np.where(lower & (side == 1), 0.5 * high, np.where(lower, high, value))
        low = np.where(~lower & (side == -1), 0.5 * low, np.where(lower, value, low))
        left, right = np.where(lower, at, left), np.where(lower, right, at)
        side[:] = np.where(lower, 1, -1)
        share[open_] = left + (right - left) * low / np.where(low == high, 1.0, low - high)
        rough = np.abs(value) > 1e-7
        open_, side = open_[rough], side[rough]
        left, right, low, high = left[rough], right[rough], low[rough], high[rough]
        if len(open_) == 0:
            break
    return np.clip(share, 0, 1)


def _sheets(crossings: Crossings) -> tuple[NDArray[np.int32], int]:
    """Number the sheets of the surface: connected triangles of one cell."""
    pairs = Topology(crossings.triangles, len(crossings.points)).face_pairs
    together = (crossings.cells[pairs[:, 0]] == crossings.cells[pairs[:, 1]]).all(axis=1)
    labels = connected_components(pairs[together], len(crossings.triangles))
    return labels, int(labels.max()) + 1


def meeting_points(
    points: Vectors, normals: Vectors, group: NDArray[np.int64], count: int, *, reach: float
) -> tuple[Vectors, NDArray[np.int64]]:
    """Return the least-squares point of the planes of each group, and the rank of the planes (3: a corner).

    Each plane is given by a point and a unit normal. Of all least-squares points, the one nearest to the mean of the
    group's points is taken, at a distance of at most `reach` from it.
    """
    number = np.maximum(np.bincount(group, minlength=count), 1)[:, None]
    mean = scatter_add(group, points, count) / number
    gap = np.einsum("ij,ij->i", normals, points - mean[group])
    scatter = scatter_add(group, normals[:, :, None] * normals[:, None, :], count)
    right = scatter_add(group, normals * gap[:, None], count)
    size, axes = np.linalg.eigh(scatter)
    keep = size > FLAT_SCATTER * size[:, 2:]
    inverse = np.divide(1, size, out=np.zeros_like(size), where=keep)
    move = np.einsum("nij,nj,nkj,nk->ni", axes, inverse, axes, right)
    length = np.linalg.norm(move, axis=1, keepdims=True)
    return mean + move * np.minimum(1, reach / np.maximum(length, 1e-300)), keep.sum(axis=1)


def _quads(crossings: Crossings, sheets: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the four sheets around each crossing, in order. Crossings at the border of the lattice have none."""
    quads = np.full((len(crossings.points), 2, 2), -1, np.int32)
    vertex = crossings.triangles.ravel()
    cell, sheet = np.repeat(crossings.cells, 3, axis=0), np.repeat(sheets, 3)
    axis = crossings.axes[vertex]
    step = cell - crossings.nodes[vertex] + 1  # 0 below the edge, 1 above it
    rows = np.arange(len(vertex))
    u, v = step[rows, (axis + 1) % 3], step[rows, (axis + 2) % 3]
    proper = axis >= 0
    quads[vertex[proper], u[proper], v[proper]] = sheet[proper]
    ring = np.stack([quads[:, 0, 0], quads[:, 1, 0], quads[:, 1, 1], quads[:, 0, 1]], axis=1)
    ring = np.where(crossings.rising[:, None], ring, ring[:, ::-1])
    return ring[(crossings.axes >= 0) & (ring >= 0).all(axis=1)]


def _split(field: DistanceField, vertices: Vectors, quads: NDArray[np.int32]) -> NDArray[np.int32]:
    """Split quadrilaterals along the diagonal whose midpoint is nearer to the surface, or else the shorter one."""
    a, b, c, d = np.moveaxis(vertices[quads], 1, 0)
    miss = [np.abs(field(0.5 * (p + q))) for p, q in ((a, c), (b, d))]
    length = [np.linalg.norm(p - q, axis=1) for p, q in ((a, c), (b, d))]
    cost = [m + 1e-3 * l for m, l in zip(miss, length, strict=True)]
    first = (cost[0] <= cost[1])[:, None]
    triangles = np.where(first, quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [0, 1, 3, 1, 2, 3]])
    return triangles.reshape(-1, 3)
