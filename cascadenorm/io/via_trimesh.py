"""Formats that trimesh reads; such files are written in other formats, with the content that trimesh provides."""

import logging
from collections.abc import Iterable
from dataclasses import replace
from io import BytesIO
from typing import Any, cast
from xml.etree.ElementTree import ParseError, iterparse

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import OutputError, ReadError, reason
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import CHANNELS, Content
from cascadenorm.io.libraries import explained, unzipped
from cascadenorm.io.limits import check_expansion
from cascadenorm.io.shown import joined, placed
from cascadenorm.mesh.polygons import Polygons

TRIMESH_NEEDS = {
    "3dxml": ("lxml networkx", "formats"),
    "stp": ("cascadio", ""),
    "step": ("cascadio", ""),
    "xaml": ("lxml", "formats"),
    "zae": ("pycollada", "formats"),
}
"""Packages that a format requires, and the extra that installs them."""

READ_ONLY_FORMATS = ("3dxml", "ctm", "step", "stp", "xaml", "zae")


class TrimeshFile(MeshFile):
    """A scene of one or more meshes from trimesh. Positions are float64, in the frame of each mesh."""

    def _parse(self) -> tuple[NDArray[np.float64], Polygons]:
        import trimesh

        _check_sizes(self.data, self.format)
        logging.getLogger("trimesh").addHandler(logging.NullHandler())  # otherwise its warnings go to stderr
        with explained(f"trimesh cannot read this as {self.format}"), np.errstate(all="ignore"):
            self._scene = trimesh.load_scene(BytesIO(self.data), file_type=self.format, process=False)
        self._meshes = [g for g in self._scene.geometry.values() if isinstance(g, trimesh.Trimesh) and len(g.faces)]
        if not self._meshes:
            raise ReadError(f"trimesh finds no triangle mesh in this {self.format} file")
        if not self._scene.graph.nodes_geometry:  # a library of meshes that no scene shows
            self._scene = trimesh.Scene(self._meshes)
        sizes = [len(mesh.vertices) for mesh in self._meshes]
        self._borders = np.cumsum(sizes)[:-1]  # first vertices of all meshes but the first
        self.parts = np.repeat(np.arange(len(sizes)), sizes)
        whole = joined([_content(mesh, np.asarray(mesh.vertices, np.float64)) for mesh in self._meshes])
        return whole.positions, whole.polygons

    def _moved_pieces(self) -> Iterable[Piece]:
        raise OutputError(f"the format '{self.format}' cannot be written: choose ply, obj or glb")

    def content(self) -> Content:
        return self._read_content().without_out_of_range()

    def _read_content(self) -> Content:
        """Return all meshes, once for each time that the scene shows them, and transformed as shown."""
        numbers = {id(mesh): number for number, mesh in enumerate(self._meshes)}
        nodes = map(self._scene.graph.get, self._scene.graph.nodes_geometry)
        shown = [(matrix, self._scene.geometry[name]) for matrix, name in nodes]
        shown = [(matrix, mesh) for matrix, mesh in shown if id(mesh) in numbers]
        copies = sum(len(mesh.vertices) + len(mesh.faces) for _, mesh in shown)
        check_expansion(24 * copies, len(self.data), "the meshes that the scene of this file shows")
        positions = np.split(self.positions, self._borders)
        whole = joined([placed(_content(mesh, positions[numbers[id(mesh)]]), matrix) for matrix, mesh in shown])
        kinds = {mesh.visual.kind for _, mesh in shown}
        colors = {}
        if kinds == {"vertex"}:
            colors = dict(zip(CHANNELS, np.concatenate([m.visual.vertex_colors for _, m in shown]).T, strict=True))
        left_out = ("materials and textures",) if kinds - {"vertex", None} else ()
        return replace(whole, vertex_values=colors, left_out=left_out)

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Raise OutputError, since trimesh is only used for reading."""
        raise OutputError(f"the format '{cls.format}' cannot be written: choose ply, obj or glb")


def _content(mesh: Any, positions: NDArray[np.float64]) -> Content:
    return Content(positions, Polygons.from_rows(np.asarray(mesh.faces, np.int64)))


def trimesh_kind(format: str) -> type[TrimeshFile] | None:
    """Return the class for an extension, or None if trimesh does not support it."""
    if format not in trimesh_formats():
        return None
    return cast(type[TrimeshFile], type(f"TrimeshFile({format})", (TrimeshFile,), {"format": format}))


def trimesh_formats() -> list[str]:
    """Return the extensions that trimesh supports with the installed packages."""
    import trimesh

    return sorted({*READ_ONLY_FORMATS} & {*trimesh.available_formats()})


def _check_sizes(data: bytes, format: str) -> None:
    """Raise ReadError if a file declares more than it can contain."""
    if format not in ("3dxml", "zae"):
        return
    for _, document in unzipped(data, format, lambda name: format == "zae" and name.lower().endswith(".dae")):
        corners = 8 * _corner_count(document)  # each corner needs an index and some copies
        check_expansion(5 * corners, len(data), "the polygons of this COLLADA file")


def _corner_count(document: bytes) -> int:
    """Return the number of corners that the polygons of a COLLADA document declare."""
    total = 0
    try:
        for _, element in iterparse(BytesIO(document)):
            if element.tag.rpartition("}")[2] == "vcount":
                total += sum(abs(int(word)) for word in (element.text or "").split())
            element.clear()
    except (ParseError, ValueError) as error:
        raise ReadError(f"this COLLADA file is damaged: {reason(error)}") from None
    return total
