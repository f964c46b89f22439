"""A mesh in memory as a file, for meshes that no file contains."""

from collections.abc import Iterable
from functools import cached_property

from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content, Positions
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh.polygons import Polygons


class ArraysFile(MeshFile):
    """A binary PLY file of positions and polygons, encoded when its bytes are needed."""

    format = PlyFile.format
    encode = PlyFile.encode

    def __init__(self, positions: Positions, polygons: Polygons) -> None:
        self._read_positions, self.polygons = positions, polygons
        self.positions, self.parts, self.folder = positions, None, None

    @cached_property
    def data(self) -> bytes:  # type: ignore[override]  # read from a file in other formats
        """The bytes of the file before any vertex moved."""
        return b"".join(self.encode(Content(self._read_positions, self.polygons))[0])

    def _parse(self) -> tuple[Positions, Polygons]:
        return self._read_positions, self.polygons

    def pieces(self) -> Iterable[Piece]:
        """Return the bytes of the file with its current positions, in pieces."""
        return self.encode(self._read_content())[0]

    def _moved_pieces(self) -> Iterable[Piece]:
        return self.pieces()

    def content(self) -> Content:
        """Return the content that other formats can store."""
        return self._read_content()

    def _read_content(self) -> Content:
        return Content(self.positions, self.polygons)
