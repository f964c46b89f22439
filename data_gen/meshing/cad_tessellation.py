"""Parts as CAD kernels triangulate them.

Planar faces are triangulated from their loops alone, curved ones with a chord tolerance. Triangles are fans, long
strips and slivers, edge lengths differ a hundredfold, and coordinates are rounded. None of this is error.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.outlines import Loop, chords, circle, rounded, sketch
from cascadenorm.data_gen.meshing.polygon_triangulation import triangulated
from cascadenorm.data_gen.shapes.placement import random_rotation
from cascadenorm.mesh import Floats, Mesh, unit

Maker = Callable[[float, np.random.Generator], Mesh]
Ring = NDArray[np.int64]  # vertices along a loop, counterclockwise seen from above, or from the end of a sweep
WallProfile = list[tuple[float, float]]  # outward offsets and heights of the rings along a wall

ROUGHEST_TOLERANCE, FINEST_TOLERANCE = 0.05, 2e-6
"""Range of chord tolerances, relative to the size of a part, that is searched for the wanted number of faces. That
number varies with the inverse square root of the tolerance for strips, and with its inverse for doubly curved
surfaces, so that a power of 1.5 converges for both."""
XY = np.eye(2, 3)  # frame of the xy plane: its axes as rows
LOW_DIGITS = 0.2  # share of the parts written as text in millimetres with four decimals; the others are float32


class PartBuilder:
    """A mesh under construction. Faces that share a loop share its vertices, so that the finished mesh is closed."""

    def __init__(self, *, delaunay: bool, rng: np.random.Generator) -> None:
        self._points: list[Floats] = []
        self._faces: list[NDArray[np.int64]] = []
        self._count = 0
        self._delaunay = delaunay
        self._rng = rng

    def ring(self, points: ArrayLike) -> Ring:
        """Add vertices, (k, 3)."""
        added = np.atleast_2d(np.asarray(points, np.float64))
        self._points.append(added)
        self._count += len(added)
        return np.arange(self._count - len(added), self._count)

    def wall(self, rings: Sequence[Ring]) -> None:
        """Join consecutive rings. If they lead upward, the normals point outward."""
        way = self._rng.integers(3)
        for lower, upper in pairwise(rings):
            if len(lower) == 1 or len(upper) == 1:
                self._fan(lower, upper)
            elif len(lower) == len(upper):
                self._strip(lower, upper, way=int(way))
            else:
                self._zipped(lower, upper)

    def face(
        self, outline: Ring, holes: Sequence[Ring] = (), inner: ArrayLike = (), *, frame: Floats = XY, up: bool = True
    ) -> None:
        """Triangulate a face over the plane that `frame`, (2, 3), spans. It faces up or down from there."""
        points = np.concatenate(self._points) @ frame.T
        loops = [outline, *(hole[::-1] for hole in holes)]
        triangles = triangulated(points, loops, inner=np.asarray(inner, np.int64).tolist(), delaunay=self._delaunay)
        self._faces.append(triangles if up else triangles[:, ::-1])

    def mesh(self) -> Mesh:
        """Return the mesh built so far."""
        return Mesh(np.concatenate(self._points), np.concatenate(self._faces))

    def _fan(self, lower: Ring, upper: Ring) -> None:
        """Join a loop to an apex, which is a ring of one vertex."""
        loop = lower if len(upper) == 1 else upper
        ahead = np.roll(loop, -1)
        apex = np.full(len(loop), (upper if len(upper) == 1 else lower)[0])
        self._faces.append(np.stack([loop, ahead, apex] if len(upper) == 1 else [ahead, loop, apex], axis=1))

    def _strip(self, lower: Ring, upper: Ring, *, way: int) -> None:
        """Add two triangles per pair of sides. The diagonals run all one way, all the other way, or alternate."""
        a, b, c, d = lower, np.roll(lower, -1), np.roll(upper, -1), upper
        first = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1)
        other = np.stack([np.stack([a, b, d], axis=1), np.stack([b, c, d], axis=1)], axis=1)
        pick = np.arange(len(a)) % 2 == 1 if way == 2 else np.full(len(a), way == 1)
        self._faces.append(np.where(pick[:, None, None], other, first).reshape(-1, 3))

    def _zipped(self, lower: Ring, upper: Ring) -> None:
        """Join loops with different numbers of vertices, both evenly spaced in angle and with the same start."""
        i = k = 0
        faces = []
        while i < len(lower) or k < len(upper):
            a, d = lower[i % len(lower)], upper[k % len(upper)]
            if k == len(upper) or (i < len(lower) and (i + 1) * len(upper) <= (k + 1) * len(lower)):
                i += 1
                faces.append((a, lower[i % len(lower)], d))
            else:
                k += 1
                faces.append((a, upper[k % len(upper)], d))
        self._faces.append(np.array(faces, np.int64))


def cad_part(*, faces: int | None, rng: np.random.Generator) -> Mesh:
    """Make a random part about the origin that extends to a distance of 1 from it.

    It has about `faces` faces; None draws a usual tolerance instead. Raises UnfitShapeError if loops cross, or if the
    number of faces cannot be reached.
    """
    make = MAKERS[rng.integers(len(MAKERS))]
    seed = int(rng.integers(2**31))
    if faces is None:
        return _finished(make(float(10 ** rng.uniform(-4, -2)), np.random.default_rng(seed)), rng=rng)
    tolerance = 1e-3
    for _ in range(8):
        mesh = make(tolerance, np.random.default_rng(seed))
        ratio = len(mesh.faces) / faces
        if 0.7 <= ratio <= 1.4:
            return _finished(mesh, rng=rng)
        tolerance = min(max(tolerance * ratio**1.5, FINEST_TOLERANCE), ROUGHEST_TOLERANCE)
    raise UnfitShapeError("no chord tolerance gives so many faces")


def _finished(mesh: Mesh, *, rng: np.random.Generator) -> Mesh:
    """Rotate a part at random or not at all, and round its coordinates as a file does."""
    vertices = mesh.vertices @ random_rotation(rng=rng).T if rng.random() < 0.6 else mesh.vertices
    vertices = vertices - 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    millimetres = float(10 ** rng.uniform(1, 2.5)) / np.linalg.norm(vertices, axis=1).max()
    shift = rng.choice([0.0, 1.0]) * rng.uniform(-100, 100, 3)
    placed = vertices * millimetres + shift
    placed = np.round(placed, 4) if rng.random() < LOW_DIGITS else placed.astype(np.float32).astype(np.float64)
    out = Mesh((placed - shift) / (millimetres * np.linalg.norm(vertices, axis=1).max()), mesh.faces)
    if not (out.areas > 0).all() or not is_manifold(out):
        raise UnfitShapeError("rounding leaves faces without area")
    return out


def plate_mesh(tolerance: float, rng: np.random.Generator) -> Mesh:
    """Return a plate of any outline with worked edges, holes, countersinks, pins and domes."""
    part = PartBuilder(delaunay=bool(rng.random() < 0.6), rng=rng)
    outline, height = sketch(1.0, tolerance=tolerance, rng=rng), rng.uniform(0.05, 0.6)
    edge = float(rng.choice([0.0, 0.02, 0.05])) * min(1.0, 3 * height)
    upper = _edge(edge, tolerance=tolerance, rng=rng)
    lower = upper if rng.random() < 0.4 else [(0.0, 0.0)]
    profile = [*[(-d, z) for d, z in lower], *[(-d, height - z) for d, z in reversed(upper)]]
    rings = _rings(part, outline, profile)
    part.wall(rings)
    above: list[Ring] = []
    below: list[Ring] = []
    for center, room in _places(outline, least=edge + 0.02, rng=rng):
        _feature(part, center, room, height, above, below, tolerance=tolerance, rng=rng)
    part.face(rings[-1], above)
    part.face(rings[0], below, up=False)
    return part.mesh()


def shell_mesh(tolerance: float, rng: np.random.Generator) -> Mesh:
    """Return a curved sheet between two trimmed freeform surfaces, with a vertex density that follows the curvature."""
    part = PartBuilder(delaunay=True, rng=rng)  # ear clipping alone would fold over the hills
    outline, thickness = sketch(1.0, tolerance=tolerance, rng=rng), rng.uniform(0.03, 0.3)
    count, waves = int(rng.integers(1, 4)), rng.normal(size=(3, 2)) * rng.uniform(0.5, 3)
    heights, phases = rng.uniform(0.02, 0.2, 3) * (np.arange(3) < count), rng.uniform(0, 6, 3)
    bend = float((heights * (waves**2).sum(axis=1)).sum())
    spacing = np.sqrt(8 * tolerance / bend)

    def lift(plane: Floats) -> Floats:
        return np.asarray((heights * np.sin(plane @ waves.T + phases)).sum(axis=1))

    def ring(plane: Floats, z: float) -> Ring:
        return part.ring(np.column_stack([plane, lift(plane) + z]))

    outline = _subdivided(outline, max(spacing, 0.01))
    bottom, top = ring(outline.points, 0.0), ring(outline.points, thickness)
    part.wall([bottom, top])
    above, below, taken = [], [], [outline.points]
    for center, room in _places(outline, least=0.03, rng=rng):
        loop = circle(room * 0.6, tolerance=tolerance).moved(center)
        above.append(ring(loop.points, thickness))
        below.append(ring(loop.points, 0.0))
        part.wall([above[-1], below[-1]])
        taken.append(loop.points)
    plane = _scattered(outline, taken, spacing, rng=rng)
    part.face(top, above, ring(plane, thickness))
    part.face(bottom, below, ring(plane, 0.0), up=False)
    return part.mesh()


def revolved_mesh(tolerance: float, rng: np.random.Generator) -> Mesh:
    """Revolve a profile of lines and arcs about an axis, with one chord length for all circles or one for each."""
    part = PartBuilder(delaunay=bool(rng.random() < 0.5), rng=rng)
    count, hollow = int(rng.integers(2, 8)), rng.random() < 0.4
    z = np.cumsum(rng.uniform(0.08, 0.5, count))
    reach = rng.uniform(0.35, 1.0, count)
    inside = rng.uniform(0.1, 0.3) if hollow else 0.0
    corners = np.stack([np.repeat(reach, 2), np.concatenate([[0], np.repeat(z, 2)[:-1]])], axis=1)
    closed = np.concatenate([[(inside, 0.0)], corners, [(inside, z[-1])]])
    arcs = rng.choice([0.0, 0.03, 0.1, 0.4]) * rng.uniform(0.3, 1, len(closed))
    if not hollow:
        arcs[[0, -1]] = 0
    profile = rounded(closed, arcs, tolerance=tolerance).points
    own = rng.random() < 0.5
    most = chords(float(profile[:, 0].max()), 2 * np.pi, tolerance=tolerance)
    rings = []
    for r, height in profile:
        sides = max(chords(r, 2 * np.pi, tolerance=tolerance) if own else most, 5)
        angle = 2 * np.pi * np.arange(sides) / sides
        circle_ = np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(sides, height)])
        rings.append(part.ring(circle_ if r > 1e-9 else [(0.0, 0.0, height)]))
    part.wall([*rings, rings[0]] if hollow else rings)
    return part.mesh()


def swept(tolerance: float, rng: np.random.Generator) -> Mesh:
    """Return a tube or bar along a helix with planar ends, or closed to a ring."""
    part = PartBuilder(delaunay=bool(rng.random() < 0.5), rng=rng)
    closed, turns = rng.random() < 0.3, rng.uniform(0.4, 3.0)
    width = rng.uniform(0.06, 0.25)
    pitch = rng.uniform(2.4, 5) * width
    angle_of_all = 2 * np.pi * (1.0 if closed else turns)
    steps = chords(1.0, angle_of_all, tolerance=tolerance)
    s = np.linspace(0, angle_of_all, steps + 1)[: steps if closed else None]
    rise = 0.0 if closed else pitch / (2 * np.pi)
    path = np.column_stack([np.cos(s), np.sin(s), rise * s])
    ahead = unit(np.column_stack([-np.sin(s), np.cos(s), np.full(len(s), rise)]))
    out = np.column_stack([np.cos(s), np.sin(s), np.zeros(len(s))])
    up = np.cross(ahead, out)
    if rng.random() < 0.5:
        profile = circle(width, tolerance=tolerance)
    else:
        w, h = width * rng.uniform(0.4, 1.0, 2)
        corners = [(-w, -h), (w, -h), (w, h), (-w, h)]
        profile = rounded(corners, width * rng.choice([0.0, 0.15]), tolerance=tolerance)
    x, y = profile.points.T
    rings = [part.ring(p + x[:, None] * o + y[:, None] * u) for p, o, u in zip(path, out, up, strict=True)]
    part.wall([*rings, rings[0]] if closed else rings)
    if not closed:
        part.face(rings[-1], frame=np.stack([out[-1], up[-1]]))
        part.face(rings[0], frame=np.stack([out[0], up[0]]), up=False)
    return part.mesh()


MAKERS: tuple[Maker, ...] = (plate_mesh, plate_mesh, plate_mesh, shell_mesh, revolved_mesh, swept)


def _edge(size: float, *, tolerance: float, rng: np.random.Generator) -> WallProfile:
    """Return the offsets inward and downward along a sharp, chamfered or filleted edge, starting at the face."""
    kind = rng.integers(3) if size else 0
    if kind == 0:
        return [(0.0, 0.0)]
    if kind == 1:
        return [(size, 0.0), (0.0, size)]
    angle = np.linspace(0, np.pi / 2, chords(size, np.pi / 2, tolerance=tolerance) + 1)
    return list(zip(size * (1 - np.sin(angle)), size * (1 - np.cos(angle)), strict=True))


def _rings(part: PartBuilder, loop: Loop, profile: WallProfile) -> list[Ring]:
    return [part.ring(np.column_stack([loop.offset(d), np.full(len(loop.points), z)])) for d, z in profile]


def _places(outline: Loop, *, least: float, rng: np.random.Generator) -> list[tuple[Floats, float]]:
    """Return centres and radii of discs within an outline that touch neither it nor each other."""
    shared = rng.random() < 0.5
    usual = rng.uniform(0.03, 0.25)
    found: list[tuple[Floats, float]] = []
    border = _subdivided(outline, 0.02).points
    for _ in range(int(rng.choice([0, 10, 40, 160]))):
        center = rng.uniform(-1, 1, 2)
        room = float(np.linalg.norm(border - center, axis=1).min()) - least - 0.02
        room = min([room, *[float(np.linalg.norm(center - c)) - r - 0.01 for c, r in found]])
        wanted = usual if shared else usual * float(10 ** rng.uniform(-0.7, 0.3))
        if room > wanted and _inside(border, center):
            found.append((center, wanted))
    return found


def _inside(loop: Floats, point: Floats) -> bool:
    x, y = (loop - point).T
    ahead = np.roll(x, -1), np.roll(y, -1)
    turn = np.arctan2(x * ahead[1] - y * ahead[0], x * ahead[0] + y * ahead[1])
    return bool(abs(turn.sum()) > np.pi)


def _subdivided(loop: Loop, spacing: float) -> Loop:
    """Insert vertices so that no side is longer than `spacing`."""
    ends = np.roll(loop.points, -1, axis=0)
    counts = np.maximum(np.ceil(np.linalg.norm(ends - loop.points, axis=1) / spacing), 1).astype(int)
    share = np.concatenate([np.arange(count) / count for count in counts])[:, None]
    start, end = np.repeat(loop.points, counts, axis=0), np.repeat(ends, counts, axis=0)
    return Loop(start + share * (end - start), np.repeat(loop.outward, counts, axis=0))


def _scattered(outline: Loop, taken: list[Floats], spacing: float, *, rng: np.random.Generator) -> Floats:
    """Return points of a jittered grid within an outline, away from its loops."""
    steps = np.arange(-1.2, 1.2, max(spacing, 0.02))
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    grid = grid + rng.uniform(-0.25, 0.25, grid.shape) * spacing
    near = np.concatenate([_subdivided(Loop(loop, loop), 0.3 * spacing).points for loop in taken])
    clear = [np.linalg.norm(near - point, axis=1).min() > 0.4 * spacing for point in grid]
    inside = [_inside(taken[0], point) and not any(_inside(loop, point) for loop in taken[1:]) for point in grid]
    return np.asarray(grid[np.array(clear) & np.array(inside)])


def _feature(
    part: PartBuilder,
    center: Floats,
    room: float,
    height: float,
    above: list[Ring],
    below: list[Ring],
    *,
    tolerance: float,
    rng: np.random.Generator,
) -> None:
    """Add a hole, a pocket, a pin or a dome within a disc, and its loops to the faces above and below."""
    kind = rng.choice(["through", "through", "countersunk", "blind", "pin", "dome"])
    size = 0.5 * room if kind == "countersunk" else 0.7 * room
    if rng.random() < 0.3:
        sides = int(rng.integers(3, 9))
        angle = 2 * np.pi * np.arange(sides) / sides
        corners = size * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        loop = rounded(corners, size * rng.choice([0.0, 0.2]), tolerance=tolerance)
    else:
        loop = circle(size, tolerance=tolerance)
    loop = loop.moved(center, turn=rng.uniform(0, 2 * np.pi))
    fillet = float(rng.choice([0.0, 0.15])) * size
    angle = np.linspace(0, np.pi / 2, chords(fillet, np.pi / 2, tolerance=tolerance) + 1) if fillet else np.zeros(1)
    if kind in ("through", "countersunk"):
        sink = 0.4 * size if kind == "countersunk" else 0.0
        rings = _rings(part, loop, [(sink, height), (0.0, height - min(sink, 0.4 * height)), (0.0, 0.0)][sink == 0 :])
        below.append(rings[-1])
    elif kind == "blind":
        rings = _rings(part, loop, [(0.0, height), (0.0, height * rng.uniform(0.3, 0.8))])
        part.face(rings[-1])
    elif kind == "pin":
        tall = height + rng.uniform(0.1, 0.5)
        foot = [(fillet * (1 - np.sin(a)), height + fillet * (1 - np.cos(a))) for a in angle]
        rings = _rings(part, loop, [*foot, (0.0, tall)])
        part.face(rings[-1])
    else:
        count = chords(size, np.pi / 2, tolerance=tolerance)
        up = np.linspace(0, np.pi / 2, count + 1)[:-1]
        flat = [(center + np.cos(a) * (loop.points - center), height + size * np.sin(a)) for a in up]
        rings = [part.ring(np.column_stack([points, np.full(len(points), z)])) for points, z in flat]
        rings.append(part.ring([(*center, height + size)]))
    part.wall(rings)
    above.append(rings[0])
