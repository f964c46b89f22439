"""Surfaces of neuroimaging: FreeSurfer, and GIFTI through nibabel. Other data in the files are kept."""

import copy
import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import OutputError, ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content
from cascadenorm.io.libraries import explained
from cascadenorm.io.limits import limited_expansion
from cascadenorm.mesh.polygons import Polygons, triangulate

FREESURFER_MAGIC = b"\xff\xff\xfe"
FREESURFER_EXTENSIONS = ("pial", "white", "orig", "inflated", "smoothwm", "sphere")
"""Extensions that select the format. A file name is, for example, `lh.pial`."""
POINT, TRIANGLE = np.dtype(">f4"), np.dtype(">i4")


class FreeSurferFile(MeshFile):
    """A triangle surface of FreeSurfer. Only the positions change. Positions are float32."""

    format = "freesurfer"

    def _parse(self) -> tuple[NDArray[np.float32], Polygons]:
        data = self.data
        if not data.startswith(FREESURFER_MAGIC):
            raise ReadError("this is no triangle surface of FreeSurfer: it does not begin with the bytes ff ff fe")
        header = re.match(rb"[^\n]*\n[^\n]*\n", data)
        if header is None or len(data) < header.end() + 8:
            raise ReadError("the FreeSurfer file ends within its header: it is truncated")
        points, triangles = np.frombuffer(data, TRIANGLE, 2, header.end()).tolist()
        self._begin = header.end() + 8
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
        head: Any = FREESURFER_MAGIC + b"created by cascadenorm\n\n" + counts.tobytes()
        return [head, single.astype(POINT).tobytes(), triangles.astype(TRIANGLE).tobytes()], content.lost_as_triangles()


DIMENSIONALITY = re.compile(rb"\bDimensionality\s*=\s*[\"']([^\"']*)[\"']")
POINT_INTENT, TRIANGLE_INTENT = "NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE"


class GiftiFile(MeshFile):
    """A GIFTI file with one surface. Positions are float32 or float64."""

    format = "gii"
    needs = ("nibabel", "nibabel", "formats")
    moving_loses = ("what nibabel does not keep (layout of the XML)",)

    def _parse(self) -> tuple[NDArray[Any], Polygons]:
        from nibabel.gifti import GiftiImage, parse_gifti_fast

        for value in DIMENSIONALITY.findall(self.data):
            if value.strip() not in (b"1", b"2", b"3", b"4", b"5", b"6"):  # nibabel counts up to any number
                said = value[:20].decode("ascii", "replace")
                raise ReadError(f'Dimensionality="{said}" in this gii file is none of 1 to 6: get a complete copy')
        with explained("nibabel cannot read this as gii"), limited_expansion(len(self.data), parse_gifti_fast):
            self._image = GiftiImage.from_bytes(self.data)
        points, triangles = (self._image.get_arrays_from_intent(intent) for intent in (POINT_INTENT, TRIANGLE_INTENT))
        if len(points) != 1 or len(triangles) != 1:
            raise ReadError(
                f"this GIFTI file has {len(points)} sets of points and {len(triangles)} of triangles: "
                "only a file with one surface can be read"
            )
        positions, corners = (np.asarray(found[0].data) for found in (points, triangles))
        if positions.shape[1:] != (3,) or corners.shape[1:] != (3,) or corners.dtype.kind not in "iu":
            raise ReadError("the points or triangles of this GIFTI file are not rows of three numbers: export it again")
        kind = np.float64 if positions.dtype == np.float64 else np.float32
        return positions.astype(kind), Polygons.from_rows(corners.astype(np.int64))

    def _moved_pieces(self) -> Iterable[Piece]:
        image = copy.deepcopy(self._image)
        points = image.get_arrays_from_intent(POINT_INTENT)[0]
        points.data = self.positions.astype(points.data.dtype.newbyteorder("="))
        return [_bytes_of(image)]

    def _read_content(self) -> Content:
        others = len(self._image.darrays) > 2
        return Content(self.positions, self.polygons, left_out=("values of vertices",) if others else ())

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write the triangles of content, in single precision."""
        from nibabel.gifti import GiftiDataArray, GiftiImage

        triangles, _ = triangulate(content.positions, content.polygons)
        single = content.single_positions()
        arrays = [
            GiftiDataArray(single, intent=POINT_INTENT, datatype="NIFTI_TYPE_FLOAT32"),
            GiftiDataArray(triangles.astype(np.int32), intent=TRIANGLE_INTENT, datatype="NIFTI_TYPE_INT32"),
        ]
        return [_bytes_of(GiftiImage(darrays=arrays))], content.lost_as_triangles()


def _bytes_of(image: Any) -> bytes:
    with explained("nibabel cannot write gii", OutputError, hint="choose ply"):
        return bytes(image.to_bytes())
