"""Join the meshes that a scene shows into one mesh."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.content import Content
from cascadenorm.io.limits import check_expansion
from cascadenorm.mesh.polygons import Polygons, ranges

NamedValues = Mapping[str, NDArray[Any]]
Matrix = NDArray[np.float64]  # (4, 4) transform of column vectors
Key = TypeVar("Key", bound=Hashable)

NODE = 200  # approximate memory in bytes of an instance
LARGEST_ENTRY = 1e30  # upper bound on the numbers of a transform


def placed(mesh: Content, matrix: Matrix) -> Content:
    """Return a transformed mesh. A mirroring transform reverses the faces."""
    if np.array_equal(matrix, np.eye(4)):
        return mesh
    mirrored = np.linalg.det(matrix[:3, :3]) < 0
    return replace(
        mesh,
        positions=mesh.positions @ matrix[:3, :3].T + matrix[:3, 3],
        polygons=reversed_polygons(mesh.polygons)[0] if mirrored else mesh.polygons,
    )


def joined(shown: Sequence[Content], left_out: Sequence[str] = ()) -> Content:
    """Join meshes, with the values of vertices and faces that all of them have."""
    first = np.cumsum([0, *(len(mesh.positions) for mesh in shown)])
    polygons = [m.polygons.moved_to(start, len(m.positions)) for m, start in zip(shown, first, strict=False)]
    return Content(
        np.concatenate([np.zeros((0, 3), np.float32), *(mesh.positions for mesh in shown)]),
        Polygons.joined(polygons),
        _common([mesh.vertex_values for mesh in shown]),
        _common([mesh.face_values for mesh in shown]),
        tuple(left_out),
    )


def reversed_polygons(polygons: Polygons) -> tuple[Polygons, NDArray[np.int64]]:
    """Return polygons of the opposite orientation, and the previous index of each of their corners."""
    counts, ends = polygons.counts, polygons.indptr[1:]
    places = np.repeat(2 * ends - counts - 1, counts) - ranges(ends - counts, counts)
    return Polygons(polygons.indptr, polygons.corners[places]), places


def values_of_vertices(values: NDArray[Any], corners: NDArray[np.int64], count: int) -> NDArray[Any] | None:
    """Return values of corners as values of vertices, (count, …); None if a vertex has several."""
    if len(values) != len(corners) or (corners < 0).any() or (corners >= count).any():
        return None
    found = np.zeros((count, *values.shape[1:]), values.dtype)
    found[corners] = values
    return found if np.array_equal(found[corners], values) else None


def placements(
    roots: Sequence[tuple[Key, Matrix]],
    inner: Callable[[Key], Sequence[tuple[Key, Matrix]]],
    nbytes: Callable[[Key], int],
    size: int,
) -> list[tuple[Key, Matrix]]:
    """Return everything that a scene shows, with its transform.

    `inner` returns the contents of an object, in its own frame, and `nbytes` the memory that one instance of it needs.
    That of all instances is checked against the size of the file in bytes before any is created. Raises ReadError if an
    object contains itself, the instances need too much memory, or a transform is not finite.
    """
    needed: dict[Key, int] = {}
    opened: set[Key] = set()

    def total(key: Key) -> int:
        if key in opened:
            raise ReadError("an object of this file contains itself: export the file again")
        if key not in needed:
            opened.add(key)
            needed[key] = NODE + nbytes(key) + sum(total(child) for child, _ in inner(key))
            opened.remove(key)
        return needed[key]

    try:
        check_expansion(sum(total(key) for key, _ in roots), size, "the meshes that the scene of this file shows")
    except RecursionError:
        raise ReadError("the objects of this file are nested too deeply: export the file again") from None
    found, waiting = [], list(reversed(roots))
    while waiting:
        key, matrix = waiting.pop()
        if not (np.abs(matrix) < LARGEST_ENTRY).all():
            raise ReadError("a transform of this file is not finite: export the file again")
        found.append((key, matrix))
        with np.errstate(all="ignore"):
            waiting += [(child, matrix @ own) for child, own in reversed(inner(key))]
    return found


def _common(parts: list[NamedValues]) -> NamedValues:
    """Join the values that all parts have with the same type."""
    names = [name for name in (parts[0] if parts else {}) if all(name in part for part in parts)]
    alike = [name for name in names if len({part[name].dtype for part in parts}) == 1]
    return {name: np.concatenate([part[name] for part in parts]) for name in alike}
