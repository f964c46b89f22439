"""Where the numbers of glTF accessors lie in the buffers."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.io.contract import ReadError
from cascadenorm.io.gltf_buffers import Buffers

FLOAT = 5126
KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", FLOAT: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Accessors:
    """The accessors of a document: vectors of numbers, packed, interleaved or sparse.

    Parameters
    ----------
    document : as JSON gives it, unchecked
    buffers : those that accessors lie in are loaded
    """

    def __init__(self, document: dict[str, Any], buffers: Buffers) -> None:
        self._document, self._buffers = document, buffers

    def places(self, number: int) -> NDArray[np.int64]:
        """Return the byte of the buffers at which each vector begins; raises ReadError where one lies nowhere."""
        accessor = self._document["accessors"][number]
        size, count = self._type(accessor).itemsize * WIDTHS[accessor["type"]], accessor["count"]
        sparse = accessor.get("sparse")
        if "bufferView" in accessor:
            found = self._range(accessor, count, size)
        elif sparse is not None and sparse["count"] == count:
            found = np.full(self._range(sparse["values"], count, size).shape, -1)
        else:
            raise ReadError(f"accessor {number} of the glTF document has no content: export the file again")
        if sparse is not None:
            where = self._range(sparse["indices"], sparse["count"], self._type(sparse["indices"]).itemsize)
            rows = gathered(self._buffers.data, where, self._type(sparse["indices"]))[:, 0].astype(np.int64)
            if (rows >= len(found)).any():
                raise ReadError(f"accessor {number} replaces row {rows.max()} of {len(found)}: export the file again")
            found[rows] = self._range(sparse["values"], sparse["count"], size)
            if (found < 0).any():
                raise ReadError(f"accessor {number} of the glTF document has gaps: export the file again")
        return found

    def vectors(self, number: int) -> NDArray[np.int64]:
        """Return the places of an accessor that has to be of three floats."""
        accessor = self._document["accessors"][number]
        if (accessor["componentType"], accessor["type"]) != (FLOAT, "VEC3"):
            raise ReadError(f"accessor {number} of the glTF document is not of 3 floats: export the file without that")
        return self.places(number)

    def values(self, number: int) -> NDArray[Any]:
        """Return the numbers of an accessor, one vector a row."""
        accessor = self._document["accessors"][number]
        places = self.places(number)  # loads the buffer
        return gathered(self._buffers.data, places, self._type(accessor), WIDTHS[accessor["type"]])

    @staticmethod
    def _type(accessor: dict[str, Any]) -> np.dtype[Any]:
        return np.dtype(KINDS[accessor["componentType"]])

    def _range(self, part: dict[str, Any], count: int, size: int) -> NDArray[np.int64]:
        """Return the bytes at which vectors of a size begin that a buffer view holds one after another."""
        view = self._document["bufferViews"][part["bufferView"]]
        begin, end = self._buffers.place(view["buffer"])
        start, step = view.get("byteOffset", 0) + part.get("byteOffset", 0), view.get("byteStride", size)
        if not all(isinstance(n, int) and n >= 0 for n in (start, step, count)) or (count and step < size):
            raise ReadError("an accessor of the glTF document has a wrong size: export the file again")
        if count and start + (count - 1) * step + size > end - begin:
            raise ReadError(
                f"an accessor runs past the {end - begin} bytes of buffer {view['buffer']}: the glTF file is damaged, "
                "or not the one that its buffers belong to; get a complete copy"
            )
        return np.asarray(begin + start * bool(count) + step * np.arange(count))


def gathered(data: bytes | bytearray, places: NDArray[np.int64], kind: np.dtype[Any], width: int = 1) -> NDArray[Any]:
    """Return the vectors that begin at these bytes, one a row."""
    cells = np.frombuffer(data, np.uint8)[places[:, None] + np.arange(width * kind.itemsize)]
    return np.asarray(cells.view(kind).astype(kind.newbyteorder("=")))
