"""A mesh on disk, by tiles: written once, read patch by patch."""

import json
from collections.abc import Iterator
from math import fsum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.controls.halo import Halo, Patch, Whole
from cascadenorm.errors import ReadError
from cascadenorm.geometry.neighborhoods import steps_from
from cascadenorm.io.atomic import write_atomically
from cascadenorm.mesh import Frame, Topology, frame_between
from cascadenorm.streaming.ply_rows import ELSEWHERE, PlyTables
from cascadenorm.streaming.tiles import Buckets, cuts_of

SAMPLE = 1 << 17
"""Vertices by which space is cut."""

TILES = 4
"""A patch has 2**TILES tiles: halos are read by whole tiles, so that these should be small."""

FACE = np.dtype([("id", "i8"), ("corners", "i8", (3,))])


class Gathered(NamedTuple):
    """Facts about the whole mesh.

    Parameters
    ----------
    depth : of the tree of tiles
    frame : as in `Whole`
    edges, mean_edge_length : their number, and the mean length in the frame
    """

    depth: int
    frame: Frame
    edges: int
    mean_edge_length: float

    @property
    def patches(self) -> int:
        """Number of patches."""
        return 1 << max(0, self.depth - TILES)


class Store:
    """The mesh of a file in a folder; `gather` makes it, once.

    It keeps 2 bytes of each vertex in memory, the tile that it lies in, and 4 more while it is made.
    """

    def __init__(self, tables: PlyTables, folder: Path) -> None:
        self.tables, self._folder = tables, folder
        self._kind = np.result_type(*(tables.vertices.kind[name] for name in "xyz")).newbyteorder("=")
        self._vertex = np.dtype([("id", "i8"), ("xyz", self._kind, (3,)), ("around", "i4")])
        self.moved_kind = np.dtype([("id", "i8"), ("xyz", self._kind, (3,))])
        self._complete = folder / "complete.json"

    def gather(self, vertices_in_patch: int) -> Gathered:
        """Write the mesh by tiles, unless it is there, and return what is known of the whole.

        Raises
        ------
        ReadError : a vertex that is not finite, a face that is no triangle of three vertices, vertices split at seams
        """
        if not self._complete.exists():
            found = self._written(vertices_in_patch)
            content = {**found._asdict(), "frame": [found.frame.center.tolist(), found.frame.exponent]}
            write_atomically(self._complete, [json.dumps(content).encode()], force=True)
        content = json.loads(self._complete.read_text(encoding="ascii"))
        center, exponent = content.pop("frame")
        self.whole = Gathered(frame=Frame(np.array(center), exponent), **content)
        self._open(self.whole.depth)
        self._tile = np.load(self._folder / "tile.npy")
        return self.whole

    def patch(self, number: int, rings: int) -> tuple[Patch, NDArray[Any]]:
        """Return a patch with a halo of so many rings, and the positions of its vertices, (k, 3)."""
        span = 1 << min(TILES, self.whole.depth)
        own = set(range(number * span, (number + 1) * span))
        tiles = own | self._beside(own)
        while True:
            vertices = np.concatenate([self._vertices.read(tile) for tile in sorted(tiles)])
            vertices = vertices[np.argsort(vertices["id"])]
            faces = np.concatenate([self._faces.read(tile) for tile in sorted(tiles)])
            faces = faces[np.unique(faces["id"], return_index=True)[1]]
            known = vertices["id"]
            ids = _with(known, faces["corners"])
            corners = np.searchsorted(ids, faces["corners"]).astype(np.int32)
            inside = np.isin(self._tile[ids], list(own)) & np.isin(ids, known, assume_unique=True)
            near = steps_from(Topology(corners, len(ids)), inside, rings) <= rings
            missing = set(np.unique(self._tile[ids[near]]).tolist()) - tiles
            if not missing:
                break
            tiles |= missing

        # all that is near is known: leave out the rest
        kept = near[corners].all(axis=1)
        numbers = np.cumsum(near, dtype=np.int32) - 1
        mine = vertices[near[np.searchsorted(ids, known)]]
        whole = Whole(
            frame=self.whole.frame,
            mean_edge_length=self.whole.mean_edge_length,
            groups=0,
            group=np.full(len(mine), -1, np.int32),
            around=mine["around"],
            flipped=np.zeros(int(kept.sum()), bool),
        )
        return Patch(mine["id"], numbers[corners[kept]], Halo(~inside[near], whole)), mine["xyz"]

    def _open(self, depth: int) -> None:
        self._vertices = Buckets(self._folder / "vertices.bin", self._vertex, 1 << depth)
        self._faces = Buckets(self._folder / "faces.bin", FACE, 1 << depth)

    def _beside(self, tiles: set[int]) -> set[int]:
        """Return the tiles that share a face with some."""
        found = [self._tile[self._faces.read(tile)["corners"]] for tile in sorted(tiles)]
        return set(np.unique(np.concatenate(found)).tolist())

    def _written(self, vertices_in_patch: int) -> Gathered:
        tables = self.tables
        count = tables.vertices.rows
        around = np.zeros(count, np.int32)
        for _, corners in tables.corners():
            first = int(corners.min())
            found = np.bincount(corners.ravel() - first)
            around[first : first + len(found)] += found.astype(np.int32)
        frame, sample = self._frame(around)
        parts = -(-count // vertices_in_patch)
        depth = 0 if parts == 1 else TILES + int(np.ceil(np.log2(parts)))
        cuts = cuts_of(sample, depth)
        tile = np.empty(count, np.uint16 if depth <= 16 else np.uint32)
        self._open(depth)

        def vertex_rows() -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
            for first, xyz in tables.positions():
                rows = np.empty(len(xyz), self._vertex)
                rows["id"], rows["xyz"] = np.arange(first, first + len(xyz)), xyz
                rows["around"] = around[first : first + len(xyz)]
                mine = tile[first : first + len(xyz)]
                mine[:] = cuts.tile(xyz)
                yield rows, mine

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
        self._tile = tile
        edges, mean = self._edges(frame, 1 << depth)
        return Gathered(depth, frame, edges, mean)

    def _frame(self, around: NDArray[np.int32]) -> tuple[Frame, NDArray[Any]]:
        """Return the frame of the vertices that a face uses, and a sample of these."""
        lower, upper, sample = np.full(3, np.inf), np.full(3, -np.inf), []
        stride = max(1, len(around) // SAMPLE)
        for first, found in self.tables.positions():
            xyz = found.astype(np.float64)
            if not np.isfinite(xyz).all():
                place = first + int((~np.isfinite(xyz).all(axis=1)).argmax())
                raise ReadError(f"vertex {place} is not finite", hint=ELSEWHERE).within(str(self.tables.path))
            used = xyz[around[first : first + len(xyz)] > 0]
            if len(used):
                lower, upper = np.minimum(lower, used.min(axis=0)), np.maximum(upper, used.max(axis=0))
                sample.append(used[:: min(stride, len(used))])
        if not sample:
            raise ReadError("the file has no faces", hint=ELSEWHERE).within(str(self.tables.path))
        return frame_between(lower, upper), np.concatenate(sample)

    def _edges(self, frame: Frame, tiles: int) -> tuple[int, float]:
        """Return the number of edges and their mean length, each counted in the tile of its first vertex."""
        sums, count = [], 0
        for tile in range(tiles):
            vertices, faces = self._vertices.read(tile), self._faces.read(tile)
            if not len(faces):
                continue
            ends = np.concatenate([faces["corners"][:, [i, (i + 1) % 3]] for i in range(3)])
            low, high = ends.min(axis=1), ends.max(axis=1)
            mine = self._tile[low] == tile
            keys, uses = np.unique(low[mine] * len(self._tile) + high[mine], return_counts=True)
            sides = np.stack(np.divmod(keys, len(self._tile)), axis=1)
            _check_seams(vertices, sides[uses == 1], self.tables.path)
            yet = _with(vertices["id"], sides[:, 1], alone=True)
            others = [self._vertices.read(int(other)) for other in np.unique(self._tile[yet])]
            near = np.concatenate([vertices, *(rows[np.isin(rows["id"], yet)] for rows in others)])
            near = near[np.argsort(near["id"])]
            framed = np.ldexp(near["xyz"].astype(np.float64) - frame.center, -frame.exponent)
            first, second = (framed[np.searchsorted(near["id"], side)] for side in sides.T)
            sums.append(float(np.linalg.norm(second - first, axis=1).sum()))
            count += len(sides)
        return count, fsum(sums) / count


def _with(known: NDArray[np.int64], further: NDArray[np.int64], *, alone: bool = False) -> NDArray[np.int64]:
    """Return ascending numbers with further ones among them, or these alone: most of them are known."""
    further = further.ravel()
    place = np.searchsorted(known, further)
    new = np.unique(further[known[np.minimum(place, len(known) - 1)] != further] if len(known) else further)
    return new if alone else np.sort(np.concatenate([known, new]))


def _check_seams(vertices: NDArray[Any], boundary: NDArray[np.int64], path: Path) -> None:
    """Refuse vertices at one place on the boundary, which a file in memory has joined; they lie in one tile."""
    mine = vertices[np.isin(vertices["id"], boundary)]
    if len(np.unique(mine["xyz"], axis=0)) < len(mine):
        raise ReadError("vertices of the file are duplicated along seams", hint=ELSEWHERE).within(str(path))
