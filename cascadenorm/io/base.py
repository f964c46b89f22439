"""The base class of all mesh formats: a file is read once and written with moved vertices."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.errors import MeshError, counted
from cascadenorm.io.content import Content, Labels, Positions
from cascadenorm.io.text.text import blocks
from cascadenorm.mesh import Mesh, all_in_rows, as_array, bad_faces, bad_vertices, first_places, isolated
from cascadenorm.mesh.normals import Normals, renewed_normals
from cascadenorm.mesh.polygons import Polygons, triangulate
from cascadenorm.mesh.welding import weld

Piece = bytes | memoryview

AnyMeshFile = TypeVar("AnyMeshFile", bound="MeshFile")


class MeshFile(ABC):
    """A complete mesh file in memory: when it is written, only positions and normals change.

    Attributes
    ----------
    format
        Name of the format, which is also its extension.
    positions
        (k, 3) float32 or float64, as stored in the file, including copies at seams.
    polygons
        Faces of the file. Corners are rows of `positions`.
    data
        Bytes of the file as it was read.
    folder
        Folder of the files that it references; None if it was read from a stream.
    parts
        (k,) number of the coordinate frame of each position. None if all share one frame.
    """

    format: ClassVar[str]
    counts_from: ClassVar[int] = 0  # number of the first vertex and face in this format
    needs: ClassVar[tuple[str, str, str]] = ("", "", "")  # module, package and extra that the format requires
    _isolates = False
    _weld_distance = 0.0
    mark = b""  # byte order mark that precedes `data`
    moving_loses: tuple[str, ...] = ()  # what is lost when vertices move, in words

    def __init__(self, data: bytes, folder: Path | None = None) -> None:
        self.data = data
        self.folder = folder
        self.parts: NDArray[np.int64] | None = None
        self._read_positions, self.polygons = self._parse()
        self.positions = self._read_positions

    @abstractmethod
    def _parse(self) -> tuple[Positions, Polygons]:
        """Parse `data`. Raises ReadError."""

    @abstractmethod
    def _moved_pieces(self) -> Iterable[Piece]:
        """Return `data` with its positions and normals replaced, in pieces."""

    @abstractmethod
    def _read_content(self) -> Content:
        """Return the content of `data` that other formats can store."""

    @classmethod
    @abstractmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Encode content in this format. Returns the bytes, in pieces, and what is left out, in words."""

    def isolating(self: AnyMeshFile) -> AnyMeshFile:
        """Return this file with a `mesh` that leaves out invalid vertices and faces instead of raising MeshError."""
        return self._with_mesh_settings(_isolates=True)

    def welding(self: AnyMeshFile, distance: float) -> AnyMeshFile:
        """Return this file with a `mesh` in which boundary vertices within a distance, in its unit, are joined."""
        return self._with_mesh_settings(_weld_distance=distance)

    def with_settings_of(self: AnyMeshFile, other: "MeshFile") -> AnyMeshFile:
        """Return this file with a `mesh` that isolates and welds as that of another file."""
        return self._with_mesh_settings(_isolates=other._isolates, _weld_distance=other._weld_distance)

    def _with_mesh_settings(self: AnyMeshFile, **settings: Any) -> AnyMeshFile:
        file = copy.copy(self)
        file.__dict__.update(settings)
        for name in ("mesh", "_weld", "left_out"):
            file.__dict__.pop(name, None)
        return file

    def pieces(self) -> Iterable[Piece]:
        """Return the bytes of the file with its current positions, in pieces."""
        return chain([self.mark], self._moved_pieces() if self.has_moved else [self.data])

    def files(self, path: Path, *, part_name: str = "{}") -> dict[Path, Iterable[Piece]]:
        """Return the files to write at a path, with it as the last; `part_name` is a pattern for other names."""
        return {path: self.pieces()}

    def may_write(self, path: Path) -> list[Path]:
        """Return all paths that `files` may return, whatever the positions are."""
        return [path]

    def refers_to(self) -> dict[str, bool]:
        """Return the referenced files that are not changed: name relative to its folder -> whether reading needs it."""
        return {}

    def repacked(self, kind: type["MeshFile"]) -> "MeshFile | None":
        """Return this file in another format without loss, or None if that format cannot store it."""
        return None

    def content(self) -> Content:
        """Return the content that other formats can store."""
        here = self._as_stored()
        here._isolates = self._isolates
        return here._read_content().without_out_of_range()

    def _as_stored(self: AnyMeshFile) -> AnyMeshFile:
        """Return this file as it is read after it was written."""
        return type(self)(b"".join(self._moved_pieces()), self.folder) if self.has_moved else self

    @property
    def vertex_values(self) -> Mapping[str, NDArray[Any]]:
        """(k,) values of the positions by their names in PLY, as read."""
        return self._read_content().vertex_values

    def face_labels(self) -> list[Labels]:
        """Return the labels of the polygons, such as properties and materials. A kind may occur more than once."""
        properties = self._read_content().face_values
        labels = [Labels(name, *np.unique(v, return_inverse=True)) for name, v in properties.items()]
        return [label for label in labels if label.of_faces.shape == (len(self.polygons),)]

    @cached_property
    def triangles(self) -> NDArray[np.int64]:
        """(m, 3) triangulated polygons, in order. Corners are rows of `positions`."""
        return self._cut[0]

    @cached_property
    def triangle_polygons(self) -> NDArray[np.int64]:
        """(m,) the polygon that each triangle comes from."""
        return self._cut[1]

    @cached_property
    def _cut(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        bad = self.polygons.out_of_range(len(self.positions))
        if not bad.any():
            return triangulate(self._read_positions, self.polygons)
        if not self._isolates:
            faces, first = np.unique(self.polygons.owners[bad]), self.counts_from
            which = f"{counted(len(faces), 'face uses', 'faces use')} vertices that do not exist"
            raise MeshError(
                f"{which} (faces {self._numbers(faces)}; the first references "
                f"vertex {self.polygons.corners[bad][0] + first}; there are {len(self.positions)}, counted from "
                f"{first})",
                hint="drop these faces, export the file again",
                remedy=("on_bad", "isolate"),
            )
        positions = self._read_positions if len(self.positions) else np.zeros((1, 3))
        corners = np.where(bad, 0, self.polygons.corners)
        triangles, owners = triangulate(positions, Polygons(self.polygons.indptr, corners))
        return np.where(np.isin(owners, self.polygons.owners[bad])[:, None], -1, triangles), owners

    @cached_property
    def _weld(self) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
        triangles = self.triangles
        if self._isolates:
            triangles = triangles[(triangles >= 0).all(axis=1)]
        return weld(self._read_positions, triangles, self.parts, distance=self._weld_distance)

    @property
    def welds(self) -> NDArray[np.int32]:
        """(k,) the vertex of `mesh` that each position is a copy of."""
        return self._weld[0]

    @cached_property
    def mesh(self) -> Mesh:
        """The m triangles, with n <= k vertices, since seams are closed. Raises MeshError if it would not be valid."""
        if self._isolates:
            return isolated(self.at_vertices(self.positions), self._welded_triangles)
        if not len(self.polygons) and not len(self.positions):
            raise MeshError("the file has no vertices and no faces: export the mesh again")
        if not len(self.polygons):
            vertices = counted(len(self.positions), "vertex", "vertices")
            raise MeshError(f"the file has {vertices} and no faces: reconstruct a surface from the points first")
        if not np.isfinite(self.positions).all():
            bad = ~np.asarray(np.isfinite(self.positions).all(axis=1))
            raise MeshError(
                f"{bad.sum()} of {len(bad)} vertices are not finite (vertices {self._numbers(np.flatnonzero(bad))}, "
                f"counted from {self.counts_from})",
                hint="give them a position, remove them and their faces",
                remedy=("on_bad", "isolate"),
            )
        return Mesh(self.at_vertices(self.positions), self._welded_triangles)

    @property
    def _splits(self) -> bool:
        """Whether a vertex of `mesh` has several positions, which is not the case in most files."""
        welds, first = self._weld
        return len(first) < len(welds)

    def at_vertices(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return values of the positions, (k, …), at the first position of each vertex of `mesh`, (n, …)."""
        return values.take(self._weld[1], axis=0) if self._splits else values

    @property
    def _welded_triangles(self) -> NDArray[np.integer[Any]]:
        """(m, 3) the triangles as vertices of `mesh`; -1 for corners out of range."""
        return np.append(self.welds, np.int32(-1))[self.triangles] if self._splits else self.triangles

    @property
    def bad_vertices(self) -> NDArray[np.bool_]:
        """(n,) the vertices that are not finite; `isolating` puts them at the origin."""
        return bad_vertices(self.at_vertices(self._read_positions))

    @cached_property
    def left_out(self) -> NDArray[np.bool_]:
        """(m,) the triangles that `mesh` does not contain. All False unless the file comes from `isolating`."""
        if not self._isolates:
            return np.zeros(len(self.triangles), bool)
        return bad_faces(self.at_vertices(self._read_positions), self._welded_triangles)

    def _numbers(self, places: NDArray[np.int64]) -> str:
        """Return the first few indices as the format counts them: '17, 18, 40, …'."""
        return ", ".join(map(str, places[:3] + self.counts_from)) + (", …" if len(places) > 3 else "")

    def with_vertices(self: AnyMeshFile, vertices: ArrayLike, *, limit: float = np.inf) -> AnyMeshFile:
        """Return this file with other vertices of `mesh`. All copies of a vertex move with it.

        Parameters
        ----------
        vertices
            (n, 3) finite positions, in the order of `mesh.vertices`. They are rounded to the number type of the file.
        limit
            Largest displacement after rounding to integers, in the unit of the file. It applies if the file stores
            integers.

        Returns
        -------
        A new file. Unmoved positions are bit-identical, and normals around moved ones are recomputed.

        Raises
        ------
        MeshError
            The shape is wrong, or a number is masked or not finite in the number type of the file.
        """
        mesh = self.mesh
        given = as_array(vertices, MeshError("vertices are a list whose rows have different lengths"))
        if given.shape != mesh.vertices.shape:
            raise MeshError(f"vertices have shape {given.shape}; the mesh of this file has {mesh.vertices.shape}")
        if given.dtype.kind not in "fiu":
            raise MeshError(f"vertices have type {given.dtype}; they must be numbers")
        if np.ma.is_masked(vertices):
            raise MeshError("vertices have masked coordinates; all of them must be numbers")
        wanted = given.astype(np.float64, copy=False)
        kind, welds = self.positions.dtype, self.welds
        with np.errstate(over="ignore", invalid="ignore"):
            copies = wanted.astype(kind)
            copies = copies.take(welds, axis=0) if self._splits else copies
            rounded = self._storable(copies)
            if rounded is not copies:  # otherwise `vertices` already respect the limit
                copies = wanted.take(welds, axis=0)
                while (far := np.linalg.norm(rounded.astype(np.float64) - self.positions, axis=1) > limit).any():
                    copies[far] = 0.5 * (copies[far] + self.positions[far])
                    rounded = self._storable(copies.astype(kind))
        if not np.isfinite(rounded).all():
            bad = ~all_in_rows(np.isfinite(rounded))
            raise MeshError(f"{bad.sum()} vertices are not finite as {kind} (vertices {first_places(bad)})")
        moved = copy.copy(self)
        moved.positions = rounded
        np.copyto(rounded, self.positions, where=copies == self.positions)
        present = self.at_vertices(moved.positions)
        if self._isolates:  # keep positions that are not finite
            finite = all_in_rows(np.isfinite(self.positions))[:, None]
            moved.positions = np.where(finite, moved.positions, self.positions)
            present = np.where(self.at_vertices(finite), present, mesh.vertices)
        moved.__dict__["mesh"] = mesh.moved(present)
        return moved

    def _storable(self, positions: Positions) -> Positions:
        """Return positions rounded to what the file can store, if that is less precise than their type."""
        return positions

    @property
    def has_moved(self) -> bool:
        """Whether a position differs from the file that was read."""
        return any(self._changed_in(block).any() for block in blocks(len(self.positions), 3))

    @property
    def _changed(self) -> NDArray[np.bool_]:
        """(k, 3) which coordinates differ from the file that was read."""
        return self._changed_in(slice(None))

    def _changed_in(self, rows: slice) -> NDArray[np.bool_]:
        read = self._read_positions[rows]
        return np.asarray((self.positions[rows] != read) & ~np.isnan(read))

    def _at_triangles(self, named: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return values of the polygon corners at the corners of the triangles."""
        counts = self.polygons.counts
        if (counts == 3).all():
            return named.reshape(-1, 3)
        # If a polygon visits a vertex twice, either of its two normals may be used.
        count = int(self.polygons.corners.max(initial=0)) + 2  # corners may be out of range, and are at least -1
        keys = self.polygons.owners * count + self.polygons.corners + 1
        order = np.argsort(keys, kind="stable")
        wanted = self.triangle_polygons[:, None] * count + self.triangles + 1
        return named[order[np.minimum(np.searchsorted(keys[order], wanted), len(keys) - 1)]]

    def _renewed(self, normals: Normals) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the normals for the current positions, and which of them belong to faces that moved."""
        if self._isolates:
            normals = normals._replace(corners=np.where(self.left_out[:, None], -1, normals.corners))
        return renewed_normals(normals, self.triangles, self.welds, self._read_positions, self.positions)

    def _renewed_tables(
        self, tables: dict[Any, NDArray[Any]], corners: Iterable[tuple[Any, NDArray[np.int64]]]
    ) -> tuple[dict[Any, int], NDArray[np.float64], NDArray[np.bool_]]:
        """Renew normals in several tables; for each part of the polygons, `corners` are a table and the rows in it.

        Returns the first row of each table if they are put one after another, all normals, and which of them are new.
        """
        starts = dict(zip(tables, np.cumsum([0, *map(len, tables.values())]).tolist(), strict=False))
        if not tables:
            return starts, np.zeros((0, 3)), np.zeros(0, bool)
        used = []
        for key, rows in corners:
            exists = (rows >= 0) & (rows < len(tables.get(key, ())))
            used.append(np.where(exists, rows + starts.get(key, 0), -1))
        stored = np.concatenate([np.asarray(table, np.float64) for table in tables.values()])
        return starts, *self._renewed(Normals(stored, self._at_triangles(np.concatenate(used))))
