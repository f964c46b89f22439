"""FreeSurfer triangle surfaces.

A file contains a comment line, vertices and triangles in big-endian order, and further data.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content
from cascadenorm.mesh.polygons import Polygons, triangulate

MAGIC = b"\xff\xff\xfe"
EXTENSIONS = ("pial", "white", "orig", "inflated", "smoothwm", "sphere")
"""Extensions that select the format. A file name is, for example, `lh.pial`."""
POINT, TRIANGLE = np.dtype(">f4"), np.dtype(">i4")


class FreeSurferFile(MeshFile):
    """A triangle surface of FreeSurfer. Only the positions change. Positions are float32."""

    format = "freesurfer"

    def _parse(self) -> tuple[NDArray[np.float32], Polygons]:
        data = self.data
        if not data.startswith(MAGIC):
            raise ReadError("this is no triangle surface of FreeSurfer: it does not begin with the bytes ff ff fe")
        ends = data.find(b"\n"), data.find(b"\n", data.find(b"\n") + 1)
        if min(ends) < 0 or len(data) < ends[1] + 9:
            raise ReadError("the FreeSurfer file ends within its header: it is truncated")
        points, triangles = np.frombuffer(data, TRIANGLE, 2, ends[1] + 1).tolist()
        self._begin = ends[1] + 9
        stop = self._begin + points * 3 * POINT.itemsize
        if min(points, triangles) < 0 or len(data) < stop + triangles * 3 * TRIANGLE.itemsize:
            raise ReadError(
                f"the FreeSurfer header declares {points} vertices and {triangles} triangles, more than the file "
                "holds: it is truncated; get a complete copy"
            )
        positions = np.frombuffer(data, POINT, 3 * points, self._begin).reshape(-1, 3)
        corners = np.frombuffer(data, TRIANGLE, 3 * triangles, stop).reshape(-1, 3)
        return positions.astype(np.float32), Polygons.from_rows(corners.astype(np.int64))

    def _moved_pieces(self) -> Iterable[Piece]:
        raw = np.frombuffer(self.data, POINT, self.positions.size, self._begin).reshape(-1, 3).copy()
        np.copyto(raw, self.positions, where=self._changed)
        view = memoryview(self.data)
        return [view[: self._begin], raw.tobytes(), view[self._begin + raw.nbytes :]]

    def _read_content(self) -> Content:
        return Content(self.positions, self.polygons, left_out=("the origin and the geometry of the volume",))

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write the triangles of content."""
        triangles, _ = triangulate(content.positions, content.polygons)
        single = content.single_positions()
        counts = np.array([len(single), len(triangles)], TRIANGLE)
        head: Any = MAGIC + b"created by cascadenorm\n\n" + counts.tobytes()
        return [head, single.astype(POINT).tobytes(), triangles.astype(TRIANGLE).tobytes()], content.lost_as_triangles()
