"""Formats that trimesh reads or writes; what trimesh does not hold of a file is lost when vertices move."""

from collections.abc import Iterable
from io import BytesIO
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import OutputError, ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.colors import CHANNELS, channels
from cascadenorm.io.content import Content
from cascadenorm.mesh.polygons import Polygons, triangulate

NEEDS = {
    "3dxml": "lxml networkx",
    "3mf": "lxml networkx",
    "dae": "pycollada",
    "stp": "cascadio",
    "step": "cascadio",
    "xaml": "lxml",
    "zae": "pycollada",
}
"""Packages to be installed for a format."""

INPUTS = ("3dxml", "3mf", "ctm", "dae", "glb", "gltf", "step", "stp", "xaml", "xyz", "zae")
OUTPUTS = ("3mf", "dae")  # beside the native ones; others that trimesh writes lose the faces


class TrimeshFile(MeshFile):
    """A scene of one or more meshes as trimesh holds it; positions are float64, in the frame of each mesh."""

    moving_loses = ("what trimesh does not keep (units, metadata, names)",)

    def _parse(self) -> tuple[NDArray[np.float64], Polygons]:
        import trimesh

        try:
            with np.errstate(all="ignore"):
                self._scene = trimesh.load_scene(BytesIO(self.data), file_type=self.format, process=False)
        except Exception as error:  # each of its parsers raises what it likes
            raise ReadError(f"trimesh cannot read this as {self.format}: {error or type(error).__name__}") from None
        self._meshes = [g for g in self._scene.geometry.values() if isinstance(g, trimesh.Trimesh) and len(g.faces)]
        if not self._meshes:
            raise ReadError(f"trimesh finds no triangle mesh in this {self.format} file")
        sizes = [len(mesh.vertices) for mesh in self._meshes]
        self._first = np.concatenate([[0], np.cumsum(sizes)])
        self.parts = np.repeat(np.arange(len(sizes)), sizes)
        faces = [np.asarray(m.faces, np.int64) + first for m, first in zip(self._meshes, self._first, strict=False)]
        positions = np.concatenate([np.asarray(mesh.vertices, np.float64) for mesh in self._meshes])
        return positions, Polygons.from_rows(np.concatenate(faces))

    def _moved_pieces(self) -> Iterable[Piece]:
        scene = type(self)(self.data, self.folder)
        for mesh, first, stop in zip(scene._meshes, self._first[:-1], self._first[1:], strict=True):
            mesh.vertices = self.positions[first:stop]
        return [_exported(scene._scene, self.format)]

    def _read_content(self) -> Content:
        """Return all meshes, each as often as the scene shows it and where it shows it."""
        shown = [(matrix, self._scene.geometry[name]) for matrix, name in map(self._scene.graph.get, self._nodes())]
        shown = [(matrix, mesh) for matrix, mesh in shown if any(mesh is m for m in self._meshes)]
        first = np.concatenate([[0], np.cumsum([len(mesh.vertices) for _, mesh in shown])])
        positions = np.concatenate([mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3] for matrix, mesh in shown])
        oriented = [mesh.faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else mesh.faces for matrix, mesh in shown]
        faces = np.concatenate([part + start for part, start in zip(oriented, first, strict=False)])
        kinds = {mesh.visual.kind for _, mesh in shown}
        colors = {}
        if kinds == {"vertex"}:
            colors = dict(zip(CHANNELS, np.concatenate([m.visual.vertex_colors for _, m in shown]).T, strict=True))
        left_out = ("materials and textures",) if kinds - {"vertex", None} else ()
        return Content(positions, Polygons.from_rows(faces.astype(np.int64)), colors, left_out=left_out)

    def _nodes(self) -> list[str]:
        return list(self._scene.graph.nodes_geometry)

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content with the colours of vertices."""
        import trimesh

        triangles, _ = triangulate(content.positions, content.polygons)
        colors = channels(content.vertex_values)
        mesh = trimesh.Trimesh(
            content.positions,
            triangles,
            vertex_colors=np.stack(list(colors.values()), axis=1) if colors else None,
            process=False,
        )
        lost = [f"vertex property '{name}'" for name in content.vertex_values if name not in colors]
        lost += [f"face property '{name}'" for name in content.face_values]
        if (content.polygons.counts != 3).any():
            lost.append("polygons (cut into triangles)")
        return [_exported(mesh, cls.format)], lost


def trimesh_kind(format: str) -> type[TrimeshFile] | None:
    """Return the class for an extension, or None where trimesh does not know it."""
    if format not in trimesh_formats():
        return None
    return cast(type[TrimeshFile], type(f"TrimeshFile({format})", (TrimeshFile,), {"format": format}))


def trimesh_formats() -> list[str]:
    """Return the extensions that trimesh knows with the packages installed here."""
    import trimesh

    return sorted({*INPUTS} & {*trimesh.available_formats()})


def trimesh_outputs() -> list[str]:
    """Return the extensions in which trimesh writes meshes with the packages installed here."""
    return [format for format in OUTPUTS if format in trimesh_formats()]


def _exported(scene: Any, format: str) -> bytes:
    try:
        with np.errstate(all="ignore"):
            data = _exported_collada(scene) if format == "dae" else scene.export(file_type=format)
    except Exception as error:  # each of its writers raises what it likes
        raise OutputError(
            f"trimesh cannot write {format}: {error or type(error).__name__}: choose ply or obj"
        ) from None
    if isinstance(data, str):
        return data.encode()
    if not isinstance(data, bytes):
        raise OutputError(f"trimesh writes {format} as several files: choose glb, ply or obj")
    return data


def _exported_collada(scene: Any) -> Any:
    """Return the meshes of a scene where it shows them."""
    from trimesh.exchange import dae

    exporter: Any = dae
    return exporter.export_collada(scene.dump() if hasattr(scene, "dump") else scene)
