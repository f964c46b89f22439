"""USD files: replace points and normals in their layers and keep everything else.

Points are those of the meshes themselves, before the transforms of the scene. Each mesh of a layer is moved once, even
if the scene shows it several times. Layers in other files are not read.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content, Labels
from cascadenorm.io.libraries import explained
from cascadenorm.io.limits import check_expansion
from cascadenorm.io.shown import Shown, joined
from cascadenorm.io.usd.layers import (
    CRATE,
    TEXT,
    Layers,
    copied,
    layers_named_by,
    opened,
    packed,
    quiet,
    references,
    said,
    unpacked,
    written,
)
from cascadenorm.io.usd.meshes import NORMALS, meshes_of, normal_rows, put, value
from cascadenorm.io.usd.scene import content_of, stage_of
from cascadenorm.mesh import any_in_rows, box_of
from cascadenorm.mesh.normals import Normals
from cascadenorm.mesh.polygons import Polygons


class UsdFile(MeshFile):
    """A text or binary layer. Positions are float32, in the frame of each mesh."""

    format = "usd"
    moving_loses = ("what OpenUSD does not keep (comments, layout)",)

    def _parse(self) -> tuple[NDArray[np.float32], Polygons]:
        self._files = unpacked(self.data, self.format)
        self._layers = opened(self._files)
        with explained("OpenUSD cannot read this file", said=said), quiet():  # a binary layer is parsed only here
            self._meshes = meshes_of(self._layers)
        if not self._meshes:
            elsewhere = [path for layer in self._layers.values() for path in layers_named_by(layer)]
            names = ", ".join(sorted({*elsewhere} - {""})[:3])[:100]
            hint = f"; it references {names}: name that file, or flatten this one (usdcat --flatten)" if names else ""
            raise ReadError(f"there is no mesh in this {self.format} file{hint}")
        sizes = [len(mesh.points) for mesh in self._meshes]
        check_expansion(
            sum(mesh.points.nbytes + mesh.polygons.corners.nbytes for mesh in self._meshes),
            len(self.data),
            "the meshes of this file",
        )
        self._first = np.cumsum([0, *sizes])
        self.parts = np.repeat(np.arange(len(sizes)), sizes) if len(sizes) > 1 else None
        return joined([Shown(mesh.points, mesh.polygons) for mesh in self._meshes])[:2]

    def _moved_pieces(self) -> Iterable[Piece]:
        return [self._stored(self._moved())]

    def _stored(self, layers: Layers) -> bytes:
        """Return the bytes of the file with some of its layers replaced."""
        (layer,) = layers.values()
        return written(layer, binary=self.data.startswith(CRATE))

    def _moved(self) -> Layers:
        """Return copies of the layers in which points moved."""
        changed = any_in_rows(self._changed)
        moves = [changed[a:b].any() for a, b in zip(self._first[:-1], self._first[1:], strict=True)]
        layers = {name: copied(self._layers[name]) for name in dict.fromkeys(mesh.layer for mesh in self._meshes)}
        with explained("OpenUSD cannot change this file", said=said), quiet():
            for number, mesh in enumerate(self._meshes):
                prim = layers[mesh.layer].GetPrimAtPath(mesh.prim.path)
                if not moves[number]:
                    continue
                points = self.positions[self._first[number] : self._first[number + 1]]
                put(prim, "points", points)
                finite = points[np.isfinite(points).all(axis=1)]
                if np.shape(value(mesh.prim, "extent")) == (2, 3) and len(finite):
                    put(prim, "extent", np.stack(box_of(finite)))
            for name in NORMALS:
                self._renew_normals(layers, name)
        kept = {mesh.layer for number, mesh in enumerate(self._meshes) if moves[number]}
        return {name: layer for name, layer in layers.items() if name in kept}

    def _renew_normals(self, layers: Layers, name: str) -> None:
        """Replace the normals with one name that changed, in copies of the layers."""
        rows, count = [normal_rows(mesh, name) for mesh in self._meshes], 0
        values, corners = list[NDArray[np.float64]](), list[NDArray[np.int64]]()
        for mesh, found in zip(self._meshes, rows, strict=True):
            if found is None:
                corners.append(np.full(len(mesh.polygons.corners), -1))
            else:
                values.append(found[0].astype(np.float64))
                corners.append(np.where(found[1] >= 0, found[1] + count, -1))
                count += len(found[0])
        if not count:
            return
        stored = np.concatenate(values)
        normals, renewed = self._renewed(Normals(stored, self._at_triangles(np.concatenate(corners))))
        begin = 0
        for mesh, found in zip(self._meshes, rows, strict=True):
            if found is not None:
                here = slice(begin, begin + len(found[0]))
                begin = here.stop
                if renewed[here].any():
                    mixed = np.where(renewed[here, None], normals[here], found[0])
                    put(layers[mesh.layer].GetPrimAtPath(mesh.prim.path), name, mixed)

    def refers_to(self) -> dict[str, bool]:
        """Return the names of other layers and of textures, which are not changed."""
        return dict.fromkeys(references(self._layers[next(iter(self._layers))]), False)

    def face_labels(self) -> list[Labels]:
        """Return the names of meshes."""
        sizes = [len(mesh.polygons) for mesh in self._meshes]
        return [Labels.of_parts("mesh", [mesh.prim.name for mesh in self._meshes], sizes)]

    def repacked(self, kind: type[MeshFile]) -> MeshFile | None:
        """Return this layer in another layer format without loss, or None for other formats."""
        if not issubclass(kind, UsdFile) or UsdzFile in (kind, type(self)):
            return None
        layer = self._moved().get(next(iter(self._layers)), next(iter(self._layers.values())))
        return kind(written(layer, binary=kind is not UsdaFile), self.folder)

    def _read_content(self) -> Content:
        return content_of(self._layers, len(self.data))

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content with the colours, texture coordinates and other values of vertices and faces."""
        layer, lost = stage_of(content)
        data = written(layer, binary=cls is not UsdaFile)
        return [packed({"mesh.usdc": data}) if cls is UsdzFile else data], lost


class UsdaFile(UsdFile):
    """A text layer."""

    format = "usda"


class UsdcFile(UsdFile):
    """A binary layer."""

    format = "usdc"


class UsdzFile(UsdFile):
    """An archive of layers, textures and other files. Textures and other files are not changed."""

    format = "usdz"

    def _stored(self, layers: Layers) -> bytes:
        new = {name: written(layer, binary=self._files[name].startswith(CRATE)) for name, layer in layers.items()}
        return packed({**self._files, **new})

    def refers_to(self) -> dict[str, bool]:
        """Return nothing, since an archive contains the files that it references."""
        return {}


USD = {kind.format: kind for kind in (UsdFile, UsdaFile, UsdcFile, UsdzFile)}
"""Formats by their extensions."""


def layer_format(data: bytes) -> str:
    """Return the format of a layer from its first bytes, or an empty string for other content."""
    return "usdc" if data.startswith(CRATE) else "usda" if data.startswith(TEXT) else ""
