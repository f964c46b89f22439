"""Sums over a mesh that may be too large for memory: each is taken part by part, and then over the parts."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Ints, Mesh

AT_ONCE = 1 << 22
"""Numbers of which some are selected that are held in memory at a time."""

Found = Mapping[str, NDArray[Any]]
"""What is measured of a part, by name."""


class Part(NamedTuple):
    """A part of a mesh with some of what is around it.

    Parameters
    ----------
    mesh : n vertices; with the facts of the whole, see `Mesh.as_part`
    vertices : (n,) those of the part; each vertex of the whole is in one part
    components : (c,) the number in the whole of each connected component
    """

    mesh: Mesh
    vertices: Bools
    components: Ints

    @property
    def faces(self) -> Bools:
        """(m,) the faces of the part, each with its least vertex."""
        a, b, c = self.mesh.faces.T
        return np.asarray(self.vertices[np.minimum(np.minimum(a, b), c)])

    @property
    def edges(self) -> Bools:
        """(e,) the edges of the part, each with its smaller vertex."""
        return np.asarray(self.vertices[self.mesh.topology.edges[:, 0]])

    @property
    def interior_edges(self) -> Bools:
        """(i,) those of the part among the edges with two faces."""
        return np.asarray(self.vertices[self.mesh.topology.edges[self.mesh.topology.interior_edges, 0]])


Measure = Callable[[Part], Found]


class Surface(Protocol):
    """A mesh that is looked at part by part."""

    @property
    def components(self) -> int:
        """How many connected components it has."""

    def each(self, name: str, rings: int, measure: Measure) -> Iterable[tuple[Ints, Found]]:
        """Measure each part; what is returned can be gone through several times.

        Parameters
        ----------
        name : of what is measured, by which it is found again where the work was interrupted
        rings : edges around each vertex of a part that have to be known

        Returns
        -------
        of each part the numbers of its components, and what was measured
        """


class InMemory:
    """A mesh in one part."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh

    @cached_property
    def components(self) -> int:
        return int(self._mesh.topology.face_components.max()) + 1

    def each(self, name: str, rings: int, measure: Measure) -> Iterable[tuple[Ints, Found]]:
        numbers = np.arange(self.components)
        return [(numbers, measure(Part(self._mesh, np.ones(len(self._mesh.vertices), bool), numbers)))]


def in_parts(mesh: Mesh | Surface) -> Surface:
    """Return what can be looked at part by part."""
    return InMemory(mesh) if isinstance(mesh, Mesh) else mesh


def added(parts: Iterable[tuple[Ints, Found]]) -> dict[str, NDArray[Any]]:
    """Add what was measured of the parts, by name."""
    total: dict[str, NDArray[Any]] = {}
    for _, found in parts:
        total = {name: total[name] + values if name in total else values for name, values in found.items()}
    return total


def by_component(parts: Iterable[tuple[Ints, Found]], count: int) -> dict[str, NDArray[Any]]:
    """Add what was measured of the components of the parts, a row for each, to a row for each of `count` components."""
    total: dict[str, NDArray[Any]] = {}
    for components, found in parts:
        for name, rows in found.items():
            if name not in total:
                total[name] = np.zeros((count, *rows.shape[1:]), rows.dtype)
            total[name][components] += rows
    return total


def nth(blocks: Callable[[], Iterator[NDArray[np.float64]]], place: int) -> float:
    """Return the number at a place, from 0 on, among numbers in ascending order, none of which is negative.

    Their bits are in the order of the numbers, and are found 16 at a time, in four passes over the blocks.
    """
    prefix = np.uint64(0)
    for shift in map(np.uint64, (48, 32, 16, 0)):
        counts = np.zeros(1 << 16, np.int64)
        for values in blocks():
            bits = (values + 0.0).view(np.uint64) >> shift
            digits = bits[bits >> np.uint64(16) == prefix] & np.uint64(0xFFFF)
            counts += np.bincount(digits.astype(np.int64), minlength=1 << 16)
        ends = np.cumsum(counts)
        digit = int(np.searchsorted(ends, place, "right"))
        place -= int(ends[digit] - counts[digit])
        prefix = (prefix << np.uint64(16)) | np.uint64(digit)
    return float(prefix.view(np.float64))


def median(blocks: Callable[[], Iterator[NDArray[np.float64]]], count: int, below: int = 0) -> float:
    """Return the median of `count` numbers in ascending order, those that follow the first `below` ones."""
    return 0.5 * (nth(blocks, below + (count - 1) // 2) + nth(blocks, below + count // 2))
