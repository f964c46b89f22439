"""A mesh on disk, by tiles: written once, read patch by patch."""

import json
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.api.halo import Halo, Patch, Whole
from cascadenorm.errors import ReadError
from cascadenorm.geometry.neighborhoods import steps_from
from cascadenorm.io.atomic import write_atomically
from cascadenorm.mesh import Frame, Topology, Vectors, frame_between
from cascadenorm.streaming.layers import Layer
from cascadenorm.streaming.numbering import numbered
from cascadenorm.streaming.ply_rows import ELSEWHERE, PlyTables
from cascadenorm.streaming.reordering import ordered_for_cache
from cascadenorm.streaming.surface import Orientation
from cascadenorm.streaming.tiles import Buckets, cuts_of

SAMPLE = 1 << 17
"""Vertices by which space is cut."""

TILES = 4
"""A patch has 2**TILES tiles: halos are read by whole tiles, so that these should be small."""

FACE = np.dtype([("id", "u4"), ("corners", "u4", (3,))])


class StoredPatch(NamedTuple):
    """A patch as it is read.

    Parameters
    ----------
    patch : k vertices and j faces, with its halo
    positions : (k, 3) of its vertices, in the type of the file
    tiles : those that were read
    vertex_rows, face_rows : (k,), (j,) places of its vertices and faces among the rows of these tiles
    own_vertices, own_faces : numbers in the patch of what the rows of its own tiles are
    """

    patch: Patch
    positions: NDArray[Any]
    tiles: list[int]
    vertex_rows: NDArray[np.int64]
    face_rows: NDArray[np.int64]
    own_vertices: NDArray[np.int64]
    own_faces: NDArray[np.int64]


class Gathered(NamedTuple):
    """Facts about the whole mesh.

    Parameters
    ----------
    depth : of the tree of tiles
    frame : as in `Whole`
    mean_edge_length, median_edge_length, diagonal : in the frame
    groups : number of groups of the vertex update
    single_sided : whether a part of the surface cannot be oriented
    """

    depth: int
    frame: Frame
    mean_edge_length: float
    median_edge_length: float
    diagonal: float
    groups: int
    single_sided: bool

    @property
    def patches(self) -> int:
        """Number of patches."""
        return 1 << max(0, self.depth - TILES)


class Store:
    """The mesh of a file in a folder; `gather` makes it, once.

    It keeps up to 10 bytes of each vertex in memory while it is made.
    """

    def __init__(self, tables: PlyTables, folder: Path) -> None:
        self.tables, self._folder = tables, folder
        self._vertex = np.dtype([("id", "u4"), ("xyz", tables.kind, (3,)), ("around", "i4"), ("group", "i4")])
        self.moved_kind = np.dtype([("id", "u4"), ("xyz", tables.kind, (3,))])
        self._complete, self._orientation = folder / "complete.json", Orientation(folder)

    def gather(self, span: int, size: Callable[[int], int]) -> Gathered:
        """Write the mesh by tiles, unless it is there, and return what is known of the whole.

        Parameters
        ----------
        span : vertices that are held in memory at a time, with the faces around them
        size : from the number of groups of the vertex update to the vertices of a patch

        Raises
        ------
        ReadError : a vertex that is not finite, a face that is no triangle of three vertices, vertices split at seams,
            regions that share walls
        """
        if not self._complete.exists():
            found = self._written(span, size)
            content = {**found._asdict(), "frame": [found.frame.center.tolist(), found.frame.exponent]}
            write_atomically(self._complete, [json.dumps(content).encode()], force=True)
        return self.whole

    def __reduce__(self) -> "tuple[type[Store], tuple[PlyTables, Path]]":
        """Pickle where it is, for processes with the same disk."""
        return Store, (self.tables, self._folder)

    @cached_property
    def whole(self) -> Gathered:
        """What is known of the whole mesh, once it was gathered."""
        content = json.loads(self._complete.read_text(encoding="ascii"))
        center, exponent = content.pop("frame")
        return Gathered(frame=Frame(np.array(center), exponent), **content)

    @property
    def numbers(self) -> NDArray[np.uint32] | None:
        """(n,) the vertex of the file that each vertex of a patch is; None where the order of the file is kept."""
        path = self._folder / "numbers.npy"
        return np.load(path, mmap_mode="r") if path.exists() else None

    def patch(self, number: int, rings: int) -> StoredPatch:
        """Return a patch with a halo of so many rings."""
        first, last = self.tiles_of(number)
        own = set(range(first, last))
        tiles = own | self._beside(own)
        while True:
            vertices = np.concatenate([self._vertices.read(tile) for tile in sorted(tiles)])
            order = np.argsort(vertices["id"])
            own_ids, vertices = vertices["id"][self._of(tiles, own, self._vertices.starts)], vertices[order]
            face_ids, once, faces, flipped = self._faces_of(tiles)
            known = vertices["id"]
            ids = np.union1d(known, faces)
            corners = np.searchsorted(ids, faces).astype(np.int32)
            inside = np.isin(self._tile[ids], list(own)) & np.isin(ids, known, assume_unique=True)
            near = steps_from(Topology(corners, len(ids)), inside, rings) <= rings
            missing = set(np.unique(self._tile[ids[near]]).tolist()) - tiles
            if not missing:
                break
            tiles |= missing

        # all that is near is known: leave out the rest
        kept = near[corners].all(axis=1)
        numbers = np.cumsum(near, dtype=np.int32) - 1
        chosen = near[np.searchsorted(ids, known)]
        mine = vertices[chosen]
        whole = Whole(
            frame=self.whole.frame,
            mean_edge_length=self.whole.mean_edge_length,
            groups=self.whole.groups,
            group=mine["group"],
            around=mine["around"],
            flipped=flipped[kept],
        )
        patch = Patch(mine["id"].astype(np.int64), numbers[corners[kept]], Halo(~inside[near], whole))
        rows_of_own = face_ids[self._of(tiles, own, self._faces.starts)]
        return StoredPatch(
            patch=patch,
            positions=mine["xyz"],
            tiles=sorted(tiles),
            vertex_rows=order[chosen],
            face_rows=once[kept],
            own_vertices=np.searchsorted(mine["id"], own_ids),
            own_faces=np.searchsorted(face_ids[once[kept]], rows_of_own),
        )

    def tiles_of(self, number: int) -> tuple[int, int]:
        """Return the first tile of a patch, and that which follows on its last one."""
        span = 1 << min(TILES, self.whole.depth)
        return number * span, (number + 1) * span

    def vertex_layer(self, name: str, kind: Any) -> Layer:
        """Return values of all vertices under a name, each of a type."""
        return Layer(self._folder / f"{name}.bin", kind, self._vertices.starts)

    def face_layer(self, name: str, kind: Any) -> Layer:
        """Return values of all faces under a name, each of a type."""
        return Layer(self._folder / f"{name}.bin", kind, self._faces.starts)

    def rows(self, tile: int) -> tuple[NDArray[Any], NDArray[np.uint32]]:
        """Return the numbers of the vertices of a tile, and the corners of the faces at them."""
        return self._vertices.read(tile)["id"], self._faces.read(tile)["corners"]

    def _of(self, tiles: set[int], own: set[int], starts: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of the rows of some tiles are in the patch's own ones."""
        each = sorted(tiles)
        return np.repeat([tile in own for tile in each], [int(starts[tile + 1] - starts[tile]) for tile in each])

    def _faces_of(
        self, tiles: set[int]
    ) -> tuple[NDArray[np.uint32], NDArray[np.int64], NDArray[np.uint32], NDArray[np.bool_]]:
        """Return the number of the face in each row of some tiles, one row of each face, ascending, and of these faces
        the corners, and which have to be flipped."""
        rows = np.concatenate([self._faces.read(tile) for tile in sorted(tiles)])
        flipped = np.concatenate([self._orientation.flipped(tile) for tile in sorted(tiles)])
        once = np.unique(rows["id"], return_index=True)[1]
        return rows["id"], once, rows["corners"][once], flipped[once]

    @cached_property
    def _vertices(self) -> Buckets:
        return self._buckets(self.whole.depth)[0]

    @cached_property
    def _faces(self) -> Buckets:
        return self._buckets(self.whole.depth)[1]

    @cached_property
    def _tile(self) -> NDArray[Any]:
        """(n,) the tile of each vertex."""
        return np.asarray(np.load(self._folder / "tile.npy", mmap_mode="r"))

    def _buckets(self, depth: int) -> tuple[Buckets, Buckets]:
        """Return the vertices and the faces by tiles."""
        count = 1 << depth
        vertices = Buckets(self._folder / "vertices.bin", self._vertex, count)
        return vertices, Buckets(self._folder / "faces.bin", FACE, count)

    def _beside(self, tiles: set[int]) -> set[int]:
        """Return the tiles that share a face with some."""
        found = [self._tile[self._faces.read(tile)["corners"]] for tile in sorted(tiles)]
        return set(np.unique(np.concatenate(found)).tolist())

    def _written(self, span: int, size: Callable[[int], int]) -> Gathered:
        around = _faces_around(self.tables)
        frame, diagonal, sample = _frame(self.tables, around)
        tables = ordered_for_cache(self.tables, frame, around > 0, self._folder, span)
        around = around if self.numbers is None else around[self.numbers]
        np.save(self._folder / "around.npy", around)
        del around
        facts = numbered(tables, frame, self._folder, span)
        parts = -(-self.tables.vertices.rows // size(facts.groups))
        depth = 0 if parts == 1 else TILES + int(np.ceil(np.log2(parts)))
        self._vertices, self._faces = self._buckets(depth)
        self._write_tiles(tables, cuts_of(sample, depth).tile, depth)
        single_sided = self._orientation.gather(tables, self._faces, self._tile, frame)
        for name in ("around.npy", "groups.npy", "ordered.ply"):
            (self._folder / name).unlink(missing_ok=True)
        return Gathered(
            depth=depth,
            frame=frame,
            mean_edge_length=facts.mean_edge_length,
            median_edge_length=facts.median_edge_length,
            diagonal=diagonal,
            groups=facts.groups,
            single_sided=single_sided,
        )

    def _write_tiles(self, tables: PlyTables, tile_of: Callable[[NDArray[Any]], NDArray[np.int32]], depth: int) -> None:
        around = np.load(self._folder / "around.npy", mmap_mode="r")
        groups = np.load(self._folder / "groups.npy", mmap_mode="r")
        tile = np.empty(len(around), np.uint16 if depth <= 16 else np.uint32)

        def vertex_rows() -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
            for first, xyz in tables.positions():
                last = first + len(xyz)
                rows = np.empty(len(xyz), self._vertex)
                rows["id"], rows["xyz"] = np.arange(first, last), xyz
                rows["around"], rows["group"] = around[first:last], groups[first:last]
                tile[first:last] = tile_of(xyz)
                yield rows, tile[first:last]

        def face_rows() -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
            for first, corners in tables.corners():
                rows = np.empty(len(corners), FACE)
                rows["id"], rows["corners"] = np.arange(first, first + len(corners)), corners
                a, b, c = tile[corners].T
                for chosen, its in ((slice(None), a), (b != a, b), ((c != a) & (c != b), c)):
                    yield rows[chosen], its[chosen]

        self._vertices.write(vertex_rows())
        self._faces.write(face_rows())
        np.save(self._folder / "tile.npy", tile)


def _faces_around(tables: PlyTables) -> NDArray[np.int32]:
    """Count the faces around each vertex, (n,)."""
    around = np.zeros(tables.vertices.rows, np.int32)
    for _, corners in tables.corners():
        np.add.at(around, corners.ravel(), 1)
    return around


def _frame(tables: PlyTables, around: NDArray[np.int32]) -> tuple[Frame, float, Vectors]:
    """Return the frame of the vertices that a face uses, the diagonal of their box in it, and a sample of these."""
    lower, upper, sample = np.full(3, np.inf), np.full(3, -np.inf), []
    stride = max(1, len(around) // SAMPLE)
    for first, found in tables.positions():
        xyz = found.astype(np.float64)
        if not np.isfinite(xyz).all():
            place = first + int((~np.isfinite(xyz).all(axis=1)).argmax())
            raise ReadError(f"vertex {place} is not finite", hint=ELSEWHERE).within(str(tables.source))
        used = xyz[around[first : first + len(xyz)] > 0]
        if len(used):
            lower, upper = np.minimum(lower, used.min(axis=0)), np.maximum(upper, used.max(axis=0))
            sample.append(used[:: min(stride, len(used))])
    if not sample:
        raise ReadError("the file has no faces", hint=ELSEWHERE).within(str(tables.source))
    frame = frame_between(lower, upper)
    return frame, float(np.linalg.norm(frame.points(upper) - frame.points(lower))), np.concatenate(sample)
