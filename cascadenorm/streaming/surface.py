"""What is connected on a surface, told tile by tile: how faces are oriented, seams, and walls that regions share."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.geometry.orientation import patches
from cascadenorm.mesh import Bools, Frame, Ints, Mesh, connected_components
from cascadenorm.regions.shells import share_walls
from cascadenorm.streaming.ply_rows import ELSEWHERE, PlyTables
from cascadenorm.streaming.tiles import Buckets

PART = np.dtype(
    [("sum", "i8"), ("volume", "f8"), ("across", "f8", (3,)), ("origin", "f8", (3,)), ("open", "?"), ("first", "i8"),
     ("first_flipped", "?")]
)  # fmt: skip
"""Of the faces of a part: those as their first one less those flipped against it, six times the volume over an origin,
the sum of the area vectors, doubled, whether an edge bounds the patch, and the first face."""
LINK = np.dtype([("face", "i8"), ("corners", "i8", (3,)), ("code", "i4")])
"""A face with twice the number of its part, and 1 where it is flipped against the first face of that."""
NEVER = np.iinfo(np.int64).max


class _Tile(NamedTuple):
    """What a tile tells of the surface.

    Parameters
    ----------
    parts : what is connected across edges of two faces whose smaller vertex lies in the tile
    codes : (k,) of its faces, as in LINK
    links : faces that lie in further tiles as well
    junctions : faces at edges of three faces or more
    single_sided : whether a part cannot be oriented
    """

    parts: NDArray[Any]
    codes: NDArray[np.int32]
    links: NDArray[Any]
    junctions: NDArray[Any]
    single_sided: bool


class Orientation:
    """Which faces have to be flipped so that all are oriented as `geometry.orientation.oriented` does it in memory.

    Parameters
    ----------
    folder : where the part of each face is kept, by tiles
    """

    def __init__(self, folder: Path) -> None:
        self._codes, self._parts = folder / "parts.bin", folder / "parts.npz"
        self._loaded: tuple[NDArray[np.bool_], NDArray[np.int64]] | None = None  # of parts, and where tiles start

    def gather(self, tables: PlyTables, faces: Buckets, tile: NDArray[Any], frame: Frame) -> bool:
        """Orient the faces; return whether a patch has a single side, and so cannot be oriented.

        Parameters
        ----------
        faces : by tiles, those with corners in several tiles in each
        tile : (n,) that of each vertex

        Raises
        ------
        ReadError : vertices that are split at seams, regions that share walls
        """
        found, starts, count, single_sided = list[_Tile](), [0], 0, False
        with self._codes.open("wb") as file:
            for number in range(faces.count):
                rows = faces.read(number)
                starts.append(starts[-1] + len(rows))
                if len(rows):
                    here = _tile(tables, rows, tile, number, frame, count)
                    here.codes.tofile(file)
                    count += len(here.parts)
                    single_sided |= here.single_sided
                    found.append(here._replace(codes=here.codes[:0]))
        parts, links, junctions = (
            np.concatenate([getattr(here, name) for here in found]) for name in ("parts", "links", "junctions")
        )
        flipped, wall, contradicts = _to_flip(parts, links)
        if len(junctions):
            _refuse_shared_walls(tables, frame, junctions, flipped, wall)
        np.savez(self._parts, flipped=flipped, starts=np.array(starts))
        return single_sided or contradicts

    def flipped(self, tile: int) -> NDArray[np.bool_]:
        """Return which of the faces of a tile have to be flipped, in the order in which they are in its bucket."""
        if self._loaded is None:
            with np.load(self._parts) as kept:
                self._loaded = kept["flipped"], kept["starts"]
        flipped, starts = self._loaded
        start, stop = starts[tile : tile + 2].tolist()
        return _is_flipped(np.fromfile(self._codes, np.int32, stop - start, offset=4 * start), flipped)


def _is_flipped(codes: NDArray[np.int32], flipped: Bools) -> Bools:
    return np.asarray(flipped[codes >> 1] ^ (codes & 1).astype(bool))


def _tile(tables: PlyTables, rows: NDArray[Any], tile: NDArray[Any], number: int, frame: Frame, count: int) -> _Tile:
    """Find the parts of a tile, which are numbered from `count` on."""
    corners = rows["corners"].astype(np.int64)
    ids, local = np.unique(corners, return_inverse=True)
    positions = tables.positions_of(ids)
    mesh = Mesh(frame.points(positions), local.reshape(-1, 3))
    inside = tile[ids] == number
    edges, uses = mesh.topology.edges, mesh.topology.edge_faces.counts
    _refuse_seams(positions, inside, edges[uses == 1], tables.source)
    own = inside[edges[:, 0]]  # of these all faces are here
    found = patches(mesh, own)
    roots, part = np.unique(found.patch, return_inverse=True)
    codes = (2 * (count + part) + found.flipped).astype(np.int32)

    # each face counts in the tile of its first corner
    mine = tile[corners[:, 0]] == number
    sign = np.where(mine, np.where(found.flipped, -1, 1), 0)
    parts = np.zeros(len(roots), PART)
    parts["origin"] = mesh.corners[roots, 0]
    a, b, c = (mesh.corners - parts["origin"][part][:, None]).swapaxes(0, 1)
    across = np.cross(b - a, c - a)
    parts["sum"] = np.bincount(part, sign, len(roots))
    parts["volume"] = np.bincount(part, sign * np.einsum("ij,ij->i", a, np.cross(b, c)), len(roots))
    for axis in range(3):
        parts["across"][:, axis] = np.bincount(part, sign * across[:, axis], len(roots))
    parts["open"] = np.bincount(part, found.at_boundary, len(roots)) > 0
    parts["first"] = NEVER
    chosen, first = np.unique(np.where(mine, part, len(roots)), return_index=True)
    chosen, first = chosen[chosen < len(roots)], first[chosen < len(roots)]
    parts["first"][chosen], parts["first_flipped"][chosen] = rows["id"][first], found.flipped[first]

    # what other tiles have to know
    links = np.empty(len(rows), LINK)
    links["face"], links["corners"], links["code"] = rows["id"], corners, codes
    at_junction = (uses >= 3) & own
    meets = at_junction[mesh.topology.face_edges].any(axis=1)
    several = (tile[corners] != number).any(axis=1)
    return _Tile(parts, codes, links[several], links[meets], found.single_sided)


def _to_flip(parts: NDArray[Any], links: NDArray[Any]) -> tuple[Bools, Ints, bool]:
    """Return which parts have to be flipped, the patch of each by first faces, and whether one has a single side."""
    # connected components of the orientation double cover: two nodes a part, one for each orientation
    links = links[np.argsort(links["face"], kind="stable")]
    code = links["code"].astype(np.int64)
    pairs = np.flatnonzero(links["face"][1:] == links["face"][:-1])
    one, other = np.concatenate([code[pairs], code[pairs] ^ 1]), np.concatenate([code[pairs + 1], code[pairs + 1] ^ 1])
    labels = connected_components(np.stack([one, other], axis=1), 2 * len(parts)).reshape(-1, 2)
    sign = np.where(labels[:, 0] <= labels[:, 1], 1, -1)
    _, patch = np.unique(labels.min(axis=1), return_inverse=True)
    count = int(patch.max()) + 1

    # the first face of each patch, and which way most of it lies
    order = np.lexsort((parts["first"], patch))
    lead = order[np.flatnonzero(np.diff(patch[order], prepend=-1))]
    wanted = np.bincount(patch, sign * parts["sum"], count)
    first = np.where(parts["first_flipped"], -sign, sign)[lead]
    wanted = np.where(wanted == 0, first, wanted)

    # closed ones outward
    apart = np.einsum("ij,ij->i", parts["origin"] - parts["origin"][lead][patch], parts["across"])
    volume = np.bincount(patch, sign * (parts["volume"] + apart), count)
    closed = np.bincount(patch, parts["open"], count) == 0
    wanted = np.where(closed & (volume != 0), volume, wanted)
    rank = np.empty(count, np.int64)
    rank[np.argsort(parts["first"][lead])] = np.arange(count)
    return sign * wanted[patch] < 0, rank[patch], bool((labels[:, 0] == labels[:, 1]).any())


def _refuse_seams(positions: NDArray[Any], inside: Bools, boundary: NDArray[np.int32], path: Path) -> None:
    """Refuse vertices at one place on the boundary, which a file in memory has joined; they lie in one tile."""
    ends = np.unique(boundary)
    there = positions[ends[inside[ends]]] + 0.0  # -0 is 0
    if len(np.unique(there, axis=0)) < len(there):
        raise ReadError("vertices of the file are duplicated along seams", hint=ELSEWHERE).within(str(path))


def _refuse_shared_walls(tables: PlyTables, frame: Frame, junctions: NDArray[Any], flipped: Bools, wall: Ints) -> None:
    """Refuse regions that share walls, which see one another over the whole mesh."""
    found = junctions[np.unique(junctions["face"], return_index=True)[1]]
    ids, local = np.unique(found["corners"], return_inverse=True)
    corners = local.reshape(-1, 3)
    turned = _is_flipped(found["code"], flipped)
    corners[turned] = corners[turned, ::-1]
    _, wall_here = np.unique(wall[found["code"] >> 1], return_inverse=True)
    if share_walls(Mesh(frame.points(tables.positions_of(ids)), corners), wall_here):
        raise ReadError("regions of the mesh share walls, which patches do not support", hint=ELSEWHERE).within(
            str(tables.source)
        )
