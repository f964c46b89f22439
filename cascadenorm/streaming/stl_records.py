"""Binary STL files, welded on disk: triangles with corners of their own become a mesh, and are written back moved."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.stl import HEADER, RECORD
from cascadenorm.mesh.polygons import largest_coordinate, unit_normals
from cascadenorm.streaming.ply_rows import BLOCK, ELSEWHERE, PlyTables, ply_tables, write_tables
from cascadenorm.streaming.tiles import Buckets

CORNER = np.dtype([("corner", "u4"), ("xyz", "f4", (3,))])
FIRST = np.dtype([("corner", "u4"), ("first", "u4")])

MOST = 2**32 // 3
"""Triangles of a file at most: its corners are numbered in 32 bits."""


def triangle_count(path: Path) -> int:
    """Return the number of triangles of a binary STL file.

    Raises
    ------
    ReadError : it cannot be read, or its length is not that of a binary STL file
    """
    try:
        with path.open("rb") as file:
            count = int.from_bytes(file.read(HEADER)[HEADER - 4 :], "little")
        size = os.path.getsize(path)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise ReadError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not count or size != HEADER + count * RECORD.itemsize:
        raise ReadError("the file is not binary STL, and only that can be read in parts", hint=ELSEWHERE).within(
            str(path)
        )
    return count


def check_triangles(path: Path) -> None:
    """Raise ReadError unless a file is binary STL with few enough triangles for `welded`."""
    count = triangle_count(path)
    if count > MOST:
        raise ReadError(
            f"the file has {count:,} triangles, and at most {MOST:,} can be read in parts", hint="split it into several"
        ).within(str(path))


def welded(path: Path, folder: Path, span: int) -> PlyTables:
    """Join the corners of triangles that are at one place, as `mesh.welding.weld` does; vertices are in their order.

    Parameters
    ----------
    folder : where the mesh is written, once, as `welded.ply`
    span : corners held in memory at a time
    """
    mesh, part = folder / "welded.ply", folder / "part.ply"
    if not mesh.exists():
        count = 3 * triangle_count(path)
        vertices = _number(_first_corners(path, folder, count, span), folder, count, span)
        corners = (block.reshape(-1, 3) for block in _numbers(folder / "vertices_of_corners.bin"))
        write_tables(part, np.dtype(np.float32), vertices, count // 3, _positions(path, folder), corners)
        for name in ("vertices_of_corners.bin", "corners_of_vertices.bin"):
            (folder / name).unlink()
        os.replace(part, mesh)
    return ply_tables(mesh)._replace(source=path)


def moved_records(path: Path, mesh: PlyTables, moved: NDArray[Any]) -> Iterator[bytes]:
    """Return the bytes of a file with other positions of the welded vertices, (n, 3), in pieces.

    What stays keeps its bits; normals of triangles that move are those of their new place.
    """
    with path.open("rb") as file:
        yield file.read(HEADER)
        for _, corners in mesh.corners():
            records = np.fromfile(file, RECORD, len(corners))
            there = moved[corners]
            changed = (there != records["corners"]).reshape(-1, 9).any(axis=1)
            records["corners"] = np.where(there == records["corners"], records["corners"], there)
            triangles = np.arange(3 * len(records)).reshape(-1, 3)[changed]
            positions = records["corners"].reshape(-1, 3)
            records["normal"][changed] = unit_normals(positions, triangles, largest_coordinate(positions))
            yield records.tobytes()


def _records(path: Path) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """Return the number of the first corner, and positions of corners, (k, 3), for one block after the other."""
    count, first = triangle_count(path), 0
    with path.open("rb") as file:
        file.seek(HEADER)
        while first < count:
            corners = np.fromfile(file, RECORD, min(BLOCK, count - first))["corners"].reshape(-1, 3)
            yield 3 * first, corners.astype(np.float32)
            first += len(corners) // 3


def _first_corners(path: Path, folder: Path, count: int, span: int) -> Buckets:
    """Return for each corner the first one at its place, by spans of corners."""
    spans = -(-count // span)
    places = Buckets(folder / "by_place.bin", CORNER, spans)
    firsts = Buckets(folder / "by_corner.bin", FIRST, spans)

    def by_place() -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
        for first, positions in _records(path):
            rows = np.empty(len(positions), CORNER)
            rows["corner"], rows["xyz"] = np.arange(first, first + len(rows)), positions + 0.0  # -0 is 0
            keys = np.ascontiguousarray(rows["xyz"]).view(np.uint32).astype(np.uint64) @ np.array(
                [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64
            )
            yield rows, ((keys >> np.uint64(32)) % np.uint64(spans)).astype(np.int64)

    def by_corner() -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
        for number in range(spans):
            found = places.read(number)
            x, y, z = found["xyz"].T
            order = np.lexsort((z, y, x))  # those at one place stay in the order of corners
            ordered = found["xyz"][order]
            starts = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])[: len(order)]
            rows = np.empty(len(found), FIRST)
            rows["corner"] = found["corner"][order]
            rows["first"] = rows["corner"][np.flatnonzero(starts)[np.cumsum(starts) - 1]]
            yield rows, rows["corner"].astype(np.int64) // span

    places.write(by_place())
    firsts.write(by_corner())
    places.remove()
    return firsts


def _number(firsts: Buckets, folder: Path, count: int, span: int) -> int:
    """Number the vertices by their first corners; write which corner that is, and the vertex of each corner.

    Returns
    -------
    How many vertices there are
    """
    vertices = 0
    numbers = np.memmap(folder / "vertices_of_corners.bin", np.uint32, "w+", shape=(count,))
    with (folder / "corners_of_vertices.bin").open("wb") as file:
        for part in range(firsts.count):
            rows, start = firsts.read(part), part * span
            first = np.empty(len(rows), np.int64)
            first[rows["corner"].astype(np.int64) - start] = rows["first"]
            own = start + np.flatnonzero(first == np.arange(start, start + len(first)))
            own.astype(np.uint32).tofile(file)
            numbers[own] = np.arange(vertices, vertices + len(own))
            numbers[start : start + len(first)] = numbers[first]
            vertices += len(own)
    numbers.flush()
    firsts.remove()
    return vertices


def _numbers(path: Path) -> Iterator[NDArray[np.uint32]]:
    """Return the numbers in a file, block after block of three times BLOCK."""
    with path.open("rb") as file:
        while len(block := np.fromfile(file, np.uint32, 3 * BLOCK)):
            yield block


def _positions(path: Path, folder: Path) -> Iterator[NDArray[np.float32]]:
    """Return the positions of the vertices, (k, 3), block after block."""
    corners = np.memmap(path, RECORD, "r", HEADER, (triangle_count(path),))["corners"]
    for first in _numbers(folder / "corners_of_vertices.bin"):
        yield np.asarray(corners[first // 3, first % 3], np.float32)
