"""Numbers of glTF accessors: their byte offsets in the buffers, and further ones."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.gltf.buffers import Buffers, entry, with_keys
from cascadenorm.io.limits import check_expansion
from cascadenorm.mesh import box_of

FLOAT = 5126
COMPONENT_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", FLOAT: "<f4"}
INTEGER_TYPES = [np.dtype(kind) for kind in ("<i1", "<u1", "<i2", "<u2")]
STORED = [
    (np.dtype("<f4"), 1),
    *((kind, 1) for kind in INTEGER_TYPES),
    *((kind, int(np.iinfo(kind).max)) for kind in INTEGER_TYPES),
]
"""Supported storage of 3-vectors: the component type, and its value that represents 1."""
COMPONENT_COUNTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
ALIGNMENT = 4
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963  # targets of buffer views with attributes and with vertex indices

Data = bytes | bytearray | memoryview

ByteOffsets = range | NDArray[np.int64]  # byte offsets of vectors; a range if the steps are equal


class StoredVectors(NamedTuple):
    """Vectors of three numbers: their byte offsets in the buffers and their storage types."""

    at: NDArray[np.int64]  # (k,) byte offset of each vector, ascending
    kinds: NDArray[np.int8]  # (k,) row of STORED

    @classmethod
    def joined(cls, parts: list["StoredVectors"]) -> "StoredVectors":
        """Return all vectors once. Raises ReadError if some overlap."""
        if len(parts) == 1 and (parts[0].at[1:] > parts[0].at[:-1]).all():  # most files have one ascending part
            return parts[0]
        kinds = np.concatenate([np.zeros(0, np.int8), *(part.kinds for part in parts)])
        at, first, inverse = np.unique(
            np.concatenate([np.zeros(0, np.int64), *(part.at for part in parts)]),
            return_index=True,
            return_inverse=True,
        )
        if (kinds[first][inverse] != kinds).any():
            raise ReadError("vectors of this glTF file overlap in their buffer: export it again")
        return cls(at, kinds[first])

    def rows_of(self, part: "StoredVectors", corners: NDArray[np.int64]) -> NDArray[np.int64]:
        """Convert corners from rows of a part of these vectors to rows of all of them."""
        return corners if part is self else np.searchsorted(self.at, part.at)[corners]

    @property
    def ends(self) -> NDArray[np.int64]:
        """(k,) byte offset of the end of each vector."""
        return np.asarray(self.at + 3 * np.array([kind.itemsize for kind, _ in STORED])[self.kinds], np.int64)

    def overlap(self, places: ByteOffsets, size: int) -> bool:
        """Whether a vector overlaps a span of `size` bytes that begins at one of the ascending offsets."""
        if not len(places):
            return False
        begin, end = np.searchsorted(self.at, [int(places[0]), int(places[-1]) + size])
        near = slice(max(int(begin) - 1, 0), int(end))  # a vector that begins before may end within
        spans = each(places)
        next_span = np.searchsorted(spans, self.at[near], "right")
        before = (next_span > 0) & (spans[next_span - 1] + size > self.at[near])
        after = (next_span < len(spans)) & (spans[np.minimum(next_span, len(spans) - 1)] < self.ends[near])
        return bool((before | after).any())

    def read(self, data: Data) -> NDArray[np.float32]:
        """Return the vectors, (k, 3)."""
        vectors = np.zeros((len(self.at), 3), np.float32)
        for rows, kind, largest in self._alike():
            stored = gathered(data, self.at[rows], kind, 3)
            vectors[rows] = np.maximum(stored / largest, -1) if largest > 1 else stored
        return vectors

    def put(self, data: bytearray, vectors: NDArray[Any], chosen: NDArray[np.bool_]) -> None:
        """Replace the chosen vectors. Integers are rounded and clamped to the range of their type."""
        for rows, kind, largest in self._alike(chosen):
            stored = storable(vectors[rows], kind, largest)
            strided = _strided(data, self.at[rows], kind, 3)
            if strided is not None:
                strided[:] = stored
                continue
            cells = np.ascontiguousarray(stored, kind).view(np.uint8)
            np.frombuffer(data, np.uint8)[self.at[rows, None] + np.arange(cells.shape[1])] = cells

    def raw(self, data: Data) -> NDArray[Any]:
        """Return the numbers as they are stored, (k, 3). All vectors must have the same storage type."""
        return gathered(data, self.at, STORED[int(self.kinds[0])][0] if len(self.kinds) else STORED[0][0], 3)

    def _alike(
        self, chosen: NDArray[np.bool_] | None = None
    ) -> Iterator[tuple[NDArray[np.int64] | slice, np.dtype[Any], int]]:
        """Yield the chosen rows with the same storage type, that type, and its value that represents 1."""
        for number in np.flatnonzero(np.bincount(self.kinds)).tolist():
            alike = self.kinds == number
            if chosen is not None:
                alike &= chosen
            yield slice(None) if alike.all() else np.flatnonzero(alike), *STORED[number]


class Primitive(NamedTuple):
    """Triangles of one material."""

    mesh: int  # its number
    number: int  # of the primitive within the mesh
    material: int | None  # its number
    attributes: dict[str, int]  # name -> accessor
    # positions, normals: byte offsets in the buffers. There are either no normals or one for each position.
    positions: StoredVectors
    normals: StoredVectors
    triangles: NDArray[np.int64]  # (m, 3) rows of both


class Accessors:
    """The accessors of an unchecked document. `size` is that of the file, without buffers in separate files."""

    def __init__(self, document: dict[str, Any], buffers: Buffers, size: int) -> None:
        self._document, self._buffers, self._size, self._claimed = document, buffers, size, 0

    def for_reading(self) -> "Accessors":
        """Return the same accessors with no claims yet, since the limit holds for one reading of a file."""
        return Accessors(self._document, self._buffers, self._size)

    def claim(self, count: int) -> None:
        """Count numbers that are copied out of the buffers, several times if shared. Raises ReadError if too many."""
        self._claimed += 8 * count
        check_expansion(self._claimed, self._size + len(self._buffers.data), "the meshes of this glTF file")

    def places(self, number: int) -> ByteOffsets:
        """Return the byte offset of each vector in the buffers. Raises ReadError if one is undefined."""
        accessor, sparse = self._accessor(number), self._sparse(number)
        size, count = _type(accessor).itemsize * COMPONENT_COUNTS[accessor["type"]], accessor["count"]
        if "bufferView" in accessor:
            if sparse is None:
                return self._range(accessor, count, size)
            found = each(self._range(accessor, count, size))
        elif sparse is not None and sparse["count"] == count:
            found = np.full(len(self._range(sparse["values"], count, size)), -1)
        else:
            raise ReadError(f"accessor {number} of the glTF document has no data: export the file again")
        where = self._range(sparse["indices"], sparse["count"], _type(sparse["indices"]).itemsize)
        rows = gathered(self._buffers.data, where, _type(sparse["indices"]))[:, 0].astype(np.int64)
        if (rows >= len(found)).any():
            raise ReadError(
                f"sparse accessor {number} replaces element {rows.max()} of {len(found)}, counted from 0: "
                "export the file again"
            )
        found[rows] = each(self._range(sparse["values"], sparse["count"], size))
        if (found < 0).any():
            raise ReadError(f"accessor {number} of the glTF document leaves elements undefined: export the file again")
        return found

    def spans(self, number: int) -> list[tuple[ByteOffsets, int]]:
        """Return the offsets and sizes of the parts of an accessor that lie in loaded buffers."""
        accessor, sparse = self._accessor(number), self._sparse(number)
        width = _type(accessor).itemsize * COMPONENT_COUNTS[accessor["type"]]
        parts = [(accessor, accessor["count"], width)] if "bufferView" in accessor else []
        if sparse is not None:
            indices, values = sparse["indices"], sparse["values"]
            parts += [(indices, sparse["count"], _type(indices).itemsize), (values, sparse["count"], width)]
        return [
            (self._range(part, count, size), size)
            for part, count, size in parts
            if self._view(part)["buffer"] in self._buffers.places
        ]

    def vectors(self, number: int) -> StoredVectors:
        """Return the stored vectors of an accessor, which must have three components."""
        storage = self.storage(number)
        if self._accessor(number)["type"] != "VEC3" or storage not in STORED:
            raise ReadError(
                f"accessor {number} of the glTF document is not VEC3 of a supported type: export the file again"
            )
        where = self.places(number)
        self.claim(3 * len(where))
        return StoredVectors(each(where), np.full(len(where), STORED.index(storage), np.int8))

    def storage(self, number: int) -> tuple[np.dtype[Any], int]:
        """Return the type of the numbers of an accessor, and its value that represents 1."""
        accessor = self._accessor(number)
        kind = _type(accessor)
        return kind, int(np.iinfo(kind).max) if accessor.get("normalized") and kind.kind != "f" else 1

    def values(self, number: int) -> NDArray[Any]:
        """Return the numbers of an accessor, one vector per row."""
        accessor = self._accessor(number)
        places = self.places(number)  # loads the buffer
        self.claim(len(places))
        return gathered(self._buffers.data, places, _type(accessor), COMPONENT_COUNTS[accessor["type"]])

    def fractions(self, number: int) -> NDArray[np.float32] | None:
        """Return the numbers of an accessor in floating point, or None if they are integers that are not normalized."""
        values, (_, largest) = self.values(number), self.storage(number)
        if values.dtype.kind == "f":
            return values
        return None if largest == 1 else np.asarray(np.maximum(values / largest, -1), np.float32)

    def _accessor(self, number: int) -> dict[str, Any]:
        """Return an accessor. Raises ReadError if it does not exist, lacks a required key or has an unknown type."""
        accessor = entry(self._document, "accessors", number, "componentType", "count", "type")
        _check_known(accessor, f"accessors[{number}]", "componentType", [*COMPONENT_TYPES])
        _check_known(accessor, f"accessors[{number}]", "type", [*COMPONENT_COUNTS])
        return accessor

    def _sparse(self, number: int) -> dict[str, Any] | None:
        """Return the replaced elements of an accessor, if it has some. Raises ReadError if a required key is absent."""
        sparse, place = self._accessor(number).get("sparse"), f"accessors[{number}].sparse"
        if sparse is not None:
            with_keys(sparse, place, "count", "indices", "values")
            with_keys(sparse["indices"], f"{place}.indices", "bufferView", "componentType")
            _check_known(sparse["indices"], f"{place}.indices", "componentType", [*COMPONENT_TYPES])
            with_keys(sparse["values"], f"{place}.values", "bufferView")
        return sparse

    def _view(self, part: dict[str, Any]) -> dict[str, Any]:
        """Return the buffer view of an accessor. Raises ReadError if it does not exist or names no buffer."""
        return entry(self._document, "bufferViews", part["bufferView"], "buffer")

    def _range(self, part: dict[str, Any], count: int, size: int) -> range:
        """Return the byte offsets of the vectors of a buffer view, each of the given size."""
        view = self._view(part)
        begin, end = self._buffers.place(view["buffer"])
        start, step = view.get("byteOffset", 0) + part.get("byteOffset", 0), view.get("byteStride", size)
        if not all(isinstance(n, int) and n >= 0 for n in (start, step, count)) or (count and step < size):
            raise ReadError(
                "an accessor of the glTF document has an invalid count, offset or stride: export the file again"
            )
        if count and start + (count - 1) * step + size > end - begin:
            raise ReadError(
                f"an accessor runs past the {end - begin} bytes of buffer {view['buffer']}: the glTF file is damaged, "
                "or not the one that its buffers belong to; get a complete copy"
            )
        return range(begin + start, begin + start + step * count, step) if count else range(0)


def _type(part: dict[str, Any]) -> np.dtype[Any]:
    return np.dtype(COMPONENT_TYPES[part["componentType"]])


def _check_known(part: dict[str, Any], place: str, key: str, known: list[Any]) -> None:
    """Raise ReadError if an object of the document, at this place, has a value that glTF does not define."""
    if part[key] not in known:
        raise ReadError(f"{place} in the glTF document has the unknown {key} {part[key]!r}: export the file again")


class NewAccessors:
    """Accessors of a document and further ones, whose `data` begin at a byte offset of a buffer."""

    def __init__(self, document: dict[str, Any], *, buffer: int = 0, begin: int = 0) -> None:
        self.accessors: list[dict[str, Any]] = list(document.get("accessors", []))
        self.views: list[dict[str, Any]] = list(document.get("bufferViews", []))
        self.data, self._buffer, self._begin = bytearray(), buffer, begin

    def add(
        self, values: NDArray[Any], *, normalized: bool = False, bounds: bool = False, indices: bool = False
    ) -> int:
        """Append values, one vector per row, each aligned to four bytes; return the number of their accessor."""
        self.data += bytes(-(self._begin + len(self.data)) % ALIGNMENT)
        raw = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
        step = raw.shape[1] + (0 if indices else -raw.shape[1] % ALIGNMENT)
        rows = np.zeros((len(values), step), np.uint8)
        rows[:, : raw.shape[1]] = raw
        view: dict[str, Any] = {
            "buffer": self._buffer,
            "byteOffset": self._begin + len(self.data),
            "byteLength": rows.size,
            "target": ELEMENT_ARRAY_BUFFER if indices else ARRAY_BUFFER,
        }
        if step > raw.shape[1]:
            view["byteStride"] = step
        self.data += rows.tobytes()
        accessor: dict[str, Any] = {
            "bufferView": len(self.views),
            "componentType": next(number for number, kind in COMPONENT_TYPES.items() if kind == values.dtype),
            "count": len(values),
            "type": next(name for name, count in COMPONENT_COUNTS.items() if count == values.shape[1]),
        }
        if normalized:
            accessor["normalized"] = True
        if bounds and len(values):
            lower, upper = box_of(values)
            accessor |= {"min": lower.tolist(), "max": upper.tolist()}
        self.views.append(view)
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def storable(values: NDArray[Any], kind: np.dtype[Any], largest: int) -> NDArray[Any]:
    """Return numbers as a type stores them, in which `largest` represents 1: integers are rounded and clamped."""
    if kind.kind == "f":
        return values.astype(kind, copy=False)
    limits = np.iinfo(kind)
    return np.asarray(np.clip(np.rint(values * largest), max(limits.min, -limits.max), limits.max), kind)


def each(places: ByteOffsets) -> NDArray[np.int64]:
    """Return offsets as an array."""
    return np.arange(places.start, places.stop, places.step) if isinstance(places, range) else places


def gathered(data: Data, places: ByteOffsets, kind: np.dtype[Any], width: int = 1) -> NDArray[Any]:
    """Return the vectors that begin at these offsets, one per row. They may be a view of the data."""
    vectors = _strided(data, places, kind, width)
    if vectors is None:
        vectors = np.frombuffer(data, np.uint8)[each(places)[:, None] + np.arange(width * kind.itemsize)].view(kind)
    return np.asarray(vectors.astype(kind.newbyteorder("="), copy=False))


def _strided(data: Data, places: ByteOffsets, kind: np.dtype[Any], width: int) -> NDArray[Any] | None:
    """Return a view of equally spaced vectors, or None if they are not equally spaced."""
    if len(places) < 2:
        return None
    step = int(places[1] - places[0])
    uneven = not isinstance(places, range) and (np.diff(places) != step).any()
    if step < width * kind.itemsize or uneven:
        return None
    return np.ndarray((len(places), width), kind, data, int(places[0]), (step, kind.itemsize))
