"""A mesh on disk renumbered as it would be in memory, so that sums are taken and groups formed in the same order."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Frame, Vectors
from cascadenorm.mesh.ordering import OUTLIERS, POOR, Cache, morton_codes_between, renumbered_faces
from cascadenorm.streaming.ply_rows import BLOCK, PlyTables, ply_tables, write_tables
from cascadenorm.streaming.tiles import Buckets

SAMPLE = 1 << 14
"""Vertices by which the curve is cut."""

VERTEX = np.dtype([("code", "u8"), ("id", "u4"), ("xyz", "f8", (3,))])
CORNERS = np.dtype(("u4", (3,)))


def ordered_for_cache(tables: PlyTables, frame: Frame, used: NDArray[np.bool_], folder: Path, span: int) -> PlyTables:
    """Do on disk what `cascadenorm.mesh.ordered_for_cache` does in memory, with the same numbers.

    Parameters
    ----------
    used : (n,) vertices with a face
    folder : where a mesh of another order is written, and (n,) the vertex of the given mesh that each of its vertices
        is, as `numbers.npy`
    span : vertices sorted at a time

    Returns
    -------
    The mesh in a good order; the given one where it has one already
    """
    cache = Cache()
    for _, corners in tables.corners():
        cache.ask(corners)
    if cache.misses(len(used)) <= POOR:
        return tables
    spans = -(-len(used) // span)
    buckets = Buckets(folder / "by_code.bin", VERTEX, spans)
    np.save(folder / "numbers.npy", _numbers(lambda: _framed(tables, frame, used), len(used), buckets))
    numbers = np.load(folder / "numbers.npy", mmap_mode="r")  # not in memory beside the next
    places = np.empty(len(numbers), np.uint32)
    for i in range(0, len(numbers), BLOCK):
        places[numbers[i : i + BLOCK]] = np.arange(i, min(i + BLOCK, len(numbers)))
    faces = Buckets(folder / "by_first.bin", CORNERS, spans)
    faces.write(_renumbered(tables, places, span))
    moved = (tables.positions_of(numbers[i : i + BLOCK]) for i in range(0, len(numbers), BLOCK))
    path = folder / "ordered.ply"
    write_tables(path, tables.kind, len(numbers), tables.faces.rows, moved, _sorted(faces))
    faces.remove()
    return ply_tables(path)._replace(source=tables.source)


def _framed(tables: PlyTables, frame: Frame, used: NDArray[np.bool_]) -> Iterator[Vectors]:
    """Return the positions that a method sees, block after block; vertices without a face are at the origin."""
    for first, xyz in tables.positions():
        yield np.where(used[first : first + len(xyz), None], frame.points(xyz), 0.0)


def _numbers(blocks: Callable[[], Iterator[Vectors]], count: int, buckets: Buckets) -> NDArray[np.uint32]:
    """Return the vertices in their order along the curve, (n,), sorted one part of it after the other."""
    box = quantile(blocks(), OUTLIERS, count), quantile(blocks(), 1 - OUTLIERS, count)
    stride = max(1, count // SAMPLE)
    sample = np.sort(np.concatenate([morton_codes_between(xyz[::stride], *box) for xyz in blocks()]))
    cuts = sample[np.linspace(0, len(sample) - 1, buckets.count + 1).astype(int)[1:-1]]

    def rows() -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
        first = 0
        for xyz in blocks():
            found = np.empty(len(xyz), VERTEX)
            found["id"], found["xyz"] = np.arange(first, first + len(xyz)), xyz
            found["code"] = morton_codes_between(xyz, *box)
            first += len(xyz)
            yield found, np.searchsorted(cuts, found["code"], "right")

    buckets.write(rows())
    numbers, end = np.empty(count, np.uint32), 0
    for number in range(buckets.count):
        found = buckets.read(number)
        order = np.lexsort((*found["xyz"].T, found["code"]))
        numbers[end : end + len(found)] = found["id"][order]
        end += len(found)
    buckets.remove()
    return numbers


def quantile(blocks: Iterator[Vectors], share: float, count: int) -> Vectors:
    """Return the quantile of each coordinate, (3,), as `numpy.quantile` does; only values beyond it are kept."""
    place = (count - 1) * share
    below = int(place)
    sign, keep = (1, below + 2) if share < 0.5 else (-1, count - below)
    kept = np.empty((0, 3))
    for xyz in blocks:
        kept = np.concatenate([kept, sign * xyz])
        if len(kept) > keep:
            kept = np.partition(kept, keep - 1, axis=0)[:keep]
    ascending = np.sort(sign * kept, axis=0)
    two = ascending[-2:] if share < 0.5 else ascending[:2]
    return np.asarray(np.quantile(two, place - below, axis=0))


def _renumbered(
    tables: PlyTables, places: NDArray[np.uint32], span: int
) -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
    """Return faces with new numbers, and the span of their first vertex, block after block."""
    for _, corners in tables.corners():
        faces = renumbered_faces(corners, places)
        yield faces, faces[:, 0] // span


def _sorted(faces: Buckets) -> Iterator[NDArray[Any]]:
    """Return the faces of one span after the other, ascending."""
    for number in range(faces.count):
        found = faces.read(number)
        yield found[np.lexsort(found.T[::-1])]
