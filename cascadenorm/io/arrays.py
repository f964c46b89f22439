"""Meshes given as arrays in memory."""

from collections.abc import Iterable

from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content, Positions
from cascadenorm.io.ply.ply import PlyFile
from cascadenorm.mesh.polygons import Polygons


class ArraysFile(MeshFile):
    """Vertices and faces in memory. They are written as binary PLY unless another format is requested."""

    format = PlyFile.format

    def __init__(self, content: Content) -> None:
        self._given = content
        super().__init__(b"")

    def _parse(self) -> tuple[Positions, Polygons]:
        return self._given.positions, self._given.polygons

    def pieces(self) -> Iterable[Piece]:
        """Return the bytes of a PLY file."""
        return self._moved_pieces()

    def _moved_pieces(self) -> Iterable[Piece]:
        return self.encode(self.content())[0]

    def content(self) -> Content:
        """Return the vertices and faces."""
        return self._read_content()

    def _read_content(self) -> Content:
        return Content(self.positions, self.polygons)

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content as binary little-endian PLY."""
        return PlyFile.encode(content)
