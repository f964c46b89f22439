"""What follows from the order of all vertices, span after span of them: edges, and groups of the vertex update."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.detection.parts import median
from cascadenorm.mesh import Frame, Topology
from cascadenorm.mesh.topology_kernels import color_vertices
from cascadenorm.streaming.layers import Layer
from cascadenorm.streaming.ply_rows import PlyTables
from cascadenorm.streaming.tiles import Buckets

LEAF = 1 << 18
"""Numbers added at once."""


class Numbered(NamedTuple):
    """What is known of all edges and vertices.

    Parameters
    ----------
    mean_edge_length, median_edge_length : in the frame, to the last bit those of the mesh in memory
    groups : number of groups of the vertex update
    """

    mean_edge_length: float
    median_edge_length: float
    groups: int


def numbered(tables: PlyTables, frame: Frame, folder: Path, span: int) -> Numbered:
    """Gather the edges of a mesh, and write the group of each vertex, as in `Topology.vertex_colors`, to `groups.npy`.

    A vertex takes the first group that no neighbour of a lower number has. With the faces at a span of vertices, and
    the groups of all vertices before it, which stay in memory, this is done one span after the other.
    """
    count = tables.vertices.rows
    spans = -(-count // span)
    buckets = Buckets(folder / "by_number.bin", np.dtype(("u4", (3,))), spans)
    buckets.write(_with_spans(tables, span))
    groups = np.full(count, -1, np.int32)
    lengths = folder / "lengths.bin"
    with lengths.open("wb") as file:
        for number in range(spans):
            first, last = number * span, min((number + 1) * span, count)
            faces = buckets.read(number).astype(np.int64)
            if len(faces):
                ids = np.unique(faces)
                topology = Topology(np.searchsorted(ids, faces).astype(np.int32), len(ids))
                start, stop = np.searchsorted(ids, [first, last]).tolist()
                _lengths(tables, frame, ids, topology.edges, start, stop).tofile(file)
                colors = groups[ids]
                color_vertices(start, stop, topology.faces, topology.vertex_faces, colors)
                groups[ids[start:stop]] = colors[start:stop]
    buckets.remove()
    np.save(folder / "groups.npy", groups)
    edges = lengths.stat().st_size // 8
    mean = summed(lengths) / edges
    middle = median(Layer(lengths, np.float64, np.array([0, edges])).blocks, edges)
    lengths.unlink()
    return Numbered(mean, middle, int(groups.max()) + 1)


def _with_spans(tables: PlyTables, span: int) -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
    """Return faces with the span of each of their corners, one block after the other."""
    for _, corners in tables.corners():
        a, b, c = corners.T // span
        for chosen, its in ((slice(None), a), (b != a, b), ((c != a) & (c != b), c)):
            yield corners[chosen].astype(np.uint32), its[chosen]


def _lengths(
    tables: PlyTables, frame: Frame, ids: NDArray[np.int64], edges: NDArray[np.int32], start: int, stop: int
) -> NDArray[np.float64]:
    """Return the lengths of edges whose lower end is in start … stop of some vertices, in the order of the whole."""
    mine = edges[(edges[:, 0] >= start) & (edges[:, 0] < stop)]
    points = frame.points(tables.positions_of(ids))
    x, y, z = (points[mine[:, 1]] - points[mine[:, 0]]).T
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def summed(path: Path) -> float:
    """Add the numbers in a file as numpy does in memory: in halves of halves (pairwise summation)."""

    def part(start: int, count: int) -> Any:
        if count <= LEAF:
            return np.add.reduce(np.fromfile(path, np.float64, count, offset=8 * start))
        half = count // 2
        half -= half % 8
        return part(start, half) + part(start + half, count - half)

    return float(part(0, path.stat().st_size // 8))
