"""USD files: replace points and normals, as they are before the transforms of the scene, and keep all else."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content, Labels
from cascadenorm.io.libraries import explained
from cascadenorm.io.limits import check_expansion
from cascadenorm.io.shown import joined
from cascadenorm.io.usd.layers import (
    CRATE,
    TEXT,
    Layers,
    copied,
    files_within,
    layer_bytes,
    layers_named_by,
    opened,
    quiet,
    references,
    said,
    usdz_archive,
)
from cascadenorm.io.usd.meshes import USD_NORMALS, mesh_content, meshes_in, normal_rows, set_value, value
from cascadenorm.io.usd.scene import scene_content, stage_of
from cascadenorm.mesh import any_in_rows, box_of
from cascadenorm.mesh.polygons import Polygons


class UsdFile(MeshFile):
    """A text or binary layer. Positions are float32, in the frame of each mesh."""

    format = "usd"
    needs = ("pxr", "usd-core", "usd")
    moving_loses = ("what OpenUSD does not keep (comments, layout)",)

    def _parse(self) -> tuple[NDArray[np.float32], Polygons]:
        self._files = files_within(self.data, self.format)
        self._layers = opened(self._files)
        with explained("OpenUSD cannot read this file", said=said), quiet():  # a binary layer is parsed only here
            self._meshes = [mesh for name, layer in self._layers.items() for mesh in meshes_in(name, layer)]
        if not self._meshes:
            elsewhere = [path for layer in self._layers.values() for path in layers_named_by(layer)]
            names = ", ".join(sorted({*elsewhere} - {""})[:3])[:100]
            hint = f"; it references {names}: name that file, or flatten this one (usdcat --flatten)" if names else ""
            raise ReadError(f"there is no mesh in this {self.format} file{hint}")
        sizes = [len(mesh.points) for mesh in self._meshes]
        nbytes = sum(mesh.points.nbytes + mesh.polygons.corners.nbytes for mesh in self._meshes)
        check_expansion(nbytes, len(self.data), "the meshes of this file")
        self._borders = np.cumsum(sizes)[:-1]  # first points of all meshes but the first
        self.parts = np.repeat(np.arange(len(sizes)), sizes) if len(sizes) > 1 else None
        whole = joined([Content(mesh.points, mesh.polygons) for mesh in self._meshes])
        return whole.positions, whole.polygons

    def _moved_pieces(self) -> Iterable[Piece]:
        return [self._stored(self._moved())]

    def _stored(self, layers: Layers) -> bytes:
        """Return the bytes of the file with some of its layers replaced."""
        (layer,) = layers.values()
        return layer_bytes(layer, binary=self.data.startswith(CRATE))

    def _moved(self) -> Layers:
        """Return copies of the layers in which points moved."""
        changed, positions = (np.split(rows, self._borders) for rows in (any_in_rows(self._changed), self.positions))
        moved = [(mesh, own) for mesh, own, new in zip(self._meshes, positions, changed, strict=True) if new.any()]
        layers = {name: copied(self._layers[name]) for name in dict.fromkeys(mesh.layer for mesh, _ in moved)}
        with explained("OpenUSD cannot change this file", said=said), quiet():
            for mesh, points in moved:
                prim = layers[mesh.layer].GetPrimAtPath(mesh.prim.path)
                set_value(prim, "points", points)
                finite = points[np.isfinite(points).all(axis=1)]
                if np.shape(value(mesh.prim, "extent")) == (2, 3) and len(finite):
                    set_value(prim, "extent", np.stack(box_of(finite)))
            for name in USD_NORMALS:
                self._renew_normals(layers, name)
        return layers

    def _renew_normals(self, layers: Layers, name: str) -> None:
        """Replace the normals with one name that changed, in copies of the layers."""
        found = [normal_rows(mesh, name) for mesh in self._meshes]
        tables = {number: rows[0] for number, rows in enumerate(found) if rows is not None}
        none = (np.full(len(mesh.polygons.corners), -1) for mesh in self._meshes)
        corners = [missing if rows is None else rows[1] for rows, missing in zip(found, none, strict=True)]
        starts, normals, renewed = self._renewed_tables(tables, enumerate(corners))
        for number, start in starts.items():
            here, mesh = slice(start, start + len(tables[number])), self._meshes[number]
            if renewed[here].any():
                mixed = np.where(renewed[here, None], normals[here], tables[number])
                set_value(layers[mesh.layer].GetPrimAtPath(mesh.prim.path), name, mixed)

    def refers_to(self) -> dict[str, bool]:
        """Return the names of other layers and of textures, which are not changed."""
        return dict.fromkeys(references(self._layers[next(iter(self._layers))]), False)

    @property
    def vertex_values(self) -> Mapping[str, NDArray[Any]]:
        """(k,) values of the points, if all meshes have them; the scene may show the meshes in another order."""
        return joined([mesh_content(mesh) for mesh in self._meshes]).vertex_values

    def face_labels(self) -> list[Labels]:
        sizes = [len(mesh.polygons) for mesh in self._meshes]
        return [Labels.of_parts("mesh", [mesh.prim.name for mesh in self._meshes], sizes)]

    def repacked(self, kind: type[MeshFile]) -> MeshFile | None:
        if not issubclass(kind, UsdFile) or UsdzFile in (kind, type(self)):
            return None
        layer = self._moved().get(next(iter(self._layers)), next(iter(self._layers.values())))
        return kind(layer_bytes(layer, binary=kind is not UsdaFile), self.folder)

    def _read_content(self) -> Content:
        return scene_content(self._layers, len(self.data))

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content with the colours, texture coordinates and other values of vertices and faces."""
        layer, lost = stage_of(content)
        data = layer_bytes(layer, binary=cls is not UsdaFile)
        return [usdz_archive({"mesh.usdc": data}) if cls is UsdzFile else data], lost


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
        new = {name: layer_bytes(layer, binary=self._files[name].startswith(CRATE)) for name, layer in layers.items()}
        return usdz_archive({**self._files, **new})

    def refers_to(self) -> dict[str, bool]:
        """Return nothing, since an archive contains the files that it references."""
        return {}


def layer_format(data: bytes) -> str:
    """Return the format of a layer from its first bytes, or an empty string for other content."""
    return "usdc" if data.startswith(CRATE) else "usda" if data.startswith(TEXT) else ""
