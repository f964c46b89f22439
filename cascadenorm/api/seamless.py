"""Meshes of any kind with their vertices joined at seams."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.api.opened_files import moved_file
from cascadenorm.api.selection import resolve_controls, weld_controls
from cascadenorm.controls.weights import selected_faces
from cascadenorm.io import MeshFile
from cascadenorm.io.interop import adapter, is_pair, mesh_of_file, source_name
from cascadenorm.mesh import Bools, Ints32, Mesh, bad_faces, bad_vertices, isolated
from cascadenorm.mesh.welding import weld
from cascadenorm.registry.controls import Controls


class SeamlessMesh(NamedTuple):
    """A mesh as the caller passed it, together with a version in which copies of vertices at seams are joined."""

    given: Any
    vertices: NDArray[Any]  # (k, 3) vertices of `given`
    welds: Ints32  # (k,) index of each vertex in `mesh`
    mesh: Mesh
    kept: Bools | None = None  # (m,) whether each face of `given` is in `mesh`; None if all are, or for a file

    @classmethod
    def of(cls, given: Any, *, isolate: bool = False) -> "SeamlessMesh":
        """Convert a mesh of any kind except a path; `isolate` leaves out its bad faces."""
        if isinstance(given, MeshFile | Mesh):
            given = given.isolating() if isolate and isinstance(given, MeshFile) else given
            mesh = given if isinstance(given, Mesh) else mesh_of_file(given, source_name(given), may_isolate=True)
            return cls(given, mesh.vertices, np.arange(len(mesh.vertices), dtype=np.int32), mesh)
        checked_mesh = isolated if isolate else Mesh
        vertices, faces = given if is_pair(given) else adapter(given).arrays(given)
        mesh, vertices = checked_mesh(vertices, faces), np.asarray(vertices)
        kept = ~bad_faces(vertices, faces) if isolate else None
        if is_pair(given):
            return cls(given, vertices, np.arange(len(vertices), dtype=np.int32), mesh, kept)
        checked_faces = mesh.faces.astype(np.int64)
        welds, first = weld(vertices, checked_faces)
        if kept is not None:
            kept[kept] = ~bad_faces(vertices[first], welds[checked_faces])
        return cls(given, vertices, welds, checked_mesh(vertices[first], welds[checked_faces]), kept)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Floating type of the result."""
        if isinstance(self.given, MeshFile):
            return self.given.positions.dtype
        return self.vertices.dtype if self.vertices.dtype.kind == "f" else np.dtype(np.float64)

    def controls(self, controls: Controls) -> Controls:
        """Return controls over the vertices and faces of `given` as controls over `mesh`."""
        if isinstance(self.given, MeshFile):
            return resolve_controls(controls, self.given)
        if controls["only"] is not None and self.kept is not None:
            controls = {**controls, "only": selected_faces(controls["only"], len(self.kept))[self.kept]}
        return weld_controls(controls, self.welds)

    def moved(self, vertices: NDArray[Any], controls: Controls) -> Any:
        """Return a copy of `given` with new vertices of `mesh`; vertices that are not finite stay unchanged."""
        if isinstance(self.given, MeshFile):
            return moved_file(self.given, vertices, self.mesh, controls)
        if isinstance(self.given, Mesh):
            return self.given.moved(vertices)
        bad = bad_vertices(self.vertices)[:, None]
        if is_pair(self.given):
            return np.where(bad, self.vertices, vertices).astype(self.dtype, copy=False) if bad.any() else vertices
        copies = np.where(bad, self.vertices, vertices[self.welds])
        copies = np.where(copies == self.vertices, self.vertices, copies)  # keeps the sign of -0
        return adapter(self.given).with_vertices(self.given, copies)
