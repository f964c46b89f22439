"""Passes over an editable mesh: split, collapse, flip, and tangential smoothing."""

from typing import Literal

import numpy as np

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.half_edges import (
    CORNER,
    CREASE,
    RING,
    SMOOTH,
    HalfEdges,
    after,
    are_joined,
    before,
    collapse,
    collapse_keeps_manifold,
    distance,
    doubled_area_vector,
    flip,
    half_edges_of,
    is_manifold,
    leaving,
    mesh_of,
    shape,
    split,
)
from cascadenorm.data_gen.meshing.surface import fit
from cascadenorm.mesh import Floats, Ints, Mesh, kernel
from cascadenorm.mesh.vectors import add, dot, length

LONG, SHORT = 4 / 3, 4 / 5  # bounds relative to the target length (Botsch and Kobbelt 2004)
THIN_QUALITY = 0.06  # triangles of lower quality than this are repaired
TINY_EDGE = 0.12  # edges shorter than this share of the target are artefacts of the polygoniser, even along creases


def editable(mesh: Mesh, *, faces: int) -> HalfEdges:
    """Lay out a mesh for editing towards about `faces` faces. Raises UnfitShapeError if it is not manifold."""
    if not is_manifold(mesh):
        raise UnfitShapeError("the mesh is not manifold")
    half_edges = half_edges_of(mesh)
    half_edges.length[:] = np.sqrt(4 / np.sqrt(3) * mesh.area / faces)
    return half_edges


def remeshed(mesh: Mesh, *, faces: int, rounds: int) -> Mesh:
    """Return a mesh of about `faces` nearly equilateral triangles (Botsch and Kobbelt 2004), without projecting them.

    Raises UnfitShapeError if the mesh before or after is invalid.
    """
    half_edges = editable(mesh, faces=faces)
    for _ in range(rounds):
        split_long(half_edges)
        collapse_short(half_edges, SHORT)
        flip_edges(half_edges, rule="valence")
        slide(half_edges, 0.6)
    mend(half_edges)
    return fit(mesh_of(half_edges))


def flip_edges(half_edges: HalfEdges, *, rule: Literal["valence", "delaunay"]) -> None:
    """Flip unmarked, nearly flat edges towards six neighbours per vertex, or towards larger angles."""
    _flip_edges(half_edges, rule == "valence")


def mend(half_edges: HalfEdges) -> None:
    """Remove nearly degenerate triangles: collapse needles and flip the long edge of caps."""
    for _ in range(4):
        if not _mend(half_edges):
            return


@kernel
def split_long(c: HalfEdges) -> None:
    """Halve edges longer than LONG target lengths while there is room."""
    face = 0
    while face < c.used[1]:
        h, longest = -1, LONG
        if c.origin[3 * face] != -1:
            for k in range(3 * face, 3 * face + 3):
                a, b = c.origin[k], c.origin[after(k)]
                relative = distance(c.points[a], c.points[b]) / (0.5 * (c.length[a] + c.length[b]))
                if relative > longest:
                    h, longest = k, relative
        # A face whose edges are short enough is finished; a face that was split is checked again.
        if h == -1:
            face += 1
            continue
        if 3 * c.used[1] + 6 > len(c.origin) or c.used[0] == len(c.points):
            return
        # The new vertex halves the edge, and lies on a crease if the edge does.
        a, b, m = c.origin[h], c.origin[after(h)], c.used[0]
        c.used[0] += 1
        for k in range(3):
            c.points[m, k] = 0.5 * (c.points[a, k] + c.points[b, k])
        c.length[m] = 0.5 * (c.length[a] + c.length[b])
        c.kind[m] = SMOOTH if not c.marked[h] else (CORNER if c.twin[h] == -1 else CREASE)
        split(c, h, m)


@kernel
def collapse_short(c: HalfEdges, bound: float) -> None:
    """Collapse edges shorter than `bound` target lengths where this preserves creases and the surface."""
    ring, other = np.empty(RING, np.int64), np.empty(RING, np.int64)
    for k in range(3 * c.used[1]):
        h = k
        if c.origin[h] == -1 or c.twin[h] == -1:
            continue
        a, b = c.origin[h], c.origin[after(h)]
        target = 0.5 * (c.length[a] + c.length[b])
        size = distance(c.points[a], c.points[b])
        if size >= bound * target:
            continue
        # The more constrained vertex stays. A constrained one moves only along its crease, or if it nearly coincides
        # with b.
        if c.kind[a] > c.kind[b]:
            h = c.twin[h]
            a, b = b, a
        held = c.kind[a] == CORNER or (c.kind[a] == CREASE and not c.marked[h])
        if held and size > TINY_EDGE * target:
            continue
        if not collapse_keeps_manifold(c, h, ring, other):
            continue

        # Move the merged vertex to the middle of the edge, or to the constrained one.
        middle = 0.5 if c.kind[a] == c.kind[b] else 1.0
        place = c.points[a] + middle * (c.points[b] - c.points[a])
        longest = LONG * target if bound > 0.5 else 1e300
        if faces_survive(c, a, b, place, longest, ring) and faces_survive(c, b, a, place, longest, ring):
            collapse(c, h, ring)
            c.points[b] = place


@kernel
def faces_survive(c: HalfEdges, v: int, gone: int, place: Floats, longest: float, ring: Ints) -> bool:
    """Whether the faces around v, except those with `gone`, keep orientation and shape when v moves to `place`."""
    count, _ = leaving(c, v, ring)
    for i in range(count):
        p, q = c.origin[after(ring[i])], c.origin[before(ring[i])]
        if p == gone or q == gone:
            continue
        if distance(place, c.points[p]) > longest:
            return False
        old = doubled_area_vector(c.points[v], c.points[p], c.points[q])
        new = doubled_area_vector(place, c.points[p], c.points[q])
        quality = shape(c.points[v], c.points[p], c.points[q])
        if quality > 0.05 and dot(old, new) < 0.8 * length(old) * length(new):
            return False
        if shape(place, c.points[p], c.points[q]) < min(0.2, quality):
            return False
    return True


@kernel
def _flip_edges(c: HalfEdges, by_valence: bool) -> None:
    ring = np.empty(RING, np.int64)
    for h in range(3 * c.used[1]):
        g = c.twin[h]
        if c.origin[h] == -1 or g < h or c.marked[h]:
            continue
        a, b = c.origin[h], c.origin[after(h)]
        left, right = c.origin[before(h)], c.origin[before(g)]
        pa, pb, pl, pr = c.points[a], c.points[b], c.points[left], c.points[right]
        one, other = doubled_area_vector(pa, pb, pl), doubled_area_vector(pb, pa, pr)
        worst = min(shape(pa, pb, pl), shape(pb, pa, pr))
        if worst > 0.05 and dot(one, other) < 0.9 * np.sqrt(dot(one, one) * dot(other, other)):
            continue
        new_worst = min(shape(pa, pr, pl), shape(pr, pb, pl))
        # Flip towards six neighbours, three faces at a boundary, or for the better of the two triangles.
        if by_valence:
            gain = 0
            for vertex, change in ((a, -1), (b, -1), (left, 1), (right, 1)):
                count, closed = leaving(c, vertex, ring)
                goal = 6 if closed else 3
                gain += (count - goal) ** 2 - (count + change - goal) ** 2
                if count + change < 3:
                    gain = -99
            if gain <= 0 or new_worst < min(0.35, worst):
                continue
        elif new_worst <= worst + 1e-9 or leaving(c, a, ring)[0] < 5 or leaving(c, b, ring)[0] < 5:
            continue
        whole = add(one, other)
        keeps_side = dot(doubled_area_vector(pa, pr, pl), whole) > 0 and dot(doubled_area_vector(pr, pb, pl), whole) > 0
        if keeps_side and not are_joined(c, left, right, ring):
            flip(c, h)


@kernel
def _parted(c: HalfEdges, a: int, b: int, ring: Ints) -> bool:
    """Move a, which coincides with b and cannot be merged with it, slightly along its longest edge."""
    count, closed = leaving(c, a, ring)
    longest, far = 0.0, -1
    for i in range(count):
        w = c.origin[after(ring[i])]
        size = distance(c.points[a], c.points[w])
        if size > longest:
            longest, far = size, w
    if not closed or far == -1 or distance(c.points[a], c.points[b]) > 0.02 * longest:
        return False
    c.points[a] += 0.3 * (c.points[far] - c.points[a])
    return True


@kernel
def _mend(c: HalfEdges) -> int:
    ring, other = np.empty(RING, np.int64), np.empty(RING, np.int64)
    mended = 0
    for face in range(c.used[1]):
        h = 3 * face
        if c.origin[h] == -1:
            continue
        if shape(c.points[c.origin[h]], c.points[c.origin[h + 1]], c.points[c.origin[h + 2]]) > THIN_QUALITY:
            continue
        # For a degenerate triangle, either collapse the shortest edge or flip the longest one.
        short, long = h, h
        for k in range(h, h + 3):
            size = distance(c.points[c.origin[k]], c.points[c.origin[after(k)]])
            if size < distance(c.points[c.origin[short]], c.points[c.origin[after(short)]]):
                short = k
            if size >= distance(c.points[c.origin[long]], c.points[c.origin[after(long)]]):
                long = k
        a, b = c.origin[short], c.origin[after(short)]
        longest = distance(c.points[c.origin[long]], c.points[c.origin[after(long)]])
        # A needle: merge the two close vertices, or move one of them away.
        if distance(c.points[a], c.points[b]) < 0.2 * longest and c.twin[short] != -1:
            if c.kind[a] > c.kind[b]:
                short = c.twin[short]
                a, b = b, a
            if collapse_keeps_manifold(c, short, ring, other) and faces_survive(c, a, b, c.points[b], 1e300, ring):
                collapse(c, short, ring)
                mended += 1
                continue
            if _parted(c, a, b, ring):
                mended += 1
                continue
        g = c.twin[long]
        if g == -1:
            continue
        a, b, left, right = c.origin[long], c.origin[after(long)], c.origin[before(long)], c.origin[before(g)]
        pa, pb, pl, pr = c.points[a], c.points[b], c.points[left], c.points[right]
        beyond = doubled_area_vector(pb, pa, pr)
        least = min(dot(beyond, doubled_area_vector(pa, pr, pl)), dot(beyond, doubled_area_vector(pr, pb, pl)))
        if least <= 0 or are_joined(c, left, right, ring):
            continue
        if leaving(c, a, ring)[0] < 4 or leaving(c, b, ring)[0] < 4:
            continue
        # A cap: flip its longest edge, since the resulting faces have the right orientation.
        mark, p, q = c.marked[long], 3 * (long // 3), 3 * (g // 3)
        flip(c, long)
        if mark:  # the crease continues along the two short sides, through the opposite vertex
            for k in (p + 2, q + 1):
                c.marked[k] = True
                if c.twin[k] != -1:
                    c.marked[c.twin[k]] = True
            c.kind[left] = max(c.kind[left], CREASE)
        mended += 1
    return mended


@kernel
def slide(c: HalfEdges, share: float) -> None:
    """Move smooth vertices within their tangent plane, and crease ones along the crease, to the mean around them."""
    ring = np.empty(RING, np.int64)
    moved = c.points.copy()
    for v in range(c.used[0]):
        if c.start[v] == -1 or c.kind[v] == CORNER:
            continue
        count, _ = leaving(c, v, ring)
        p = c.points[v]
        # Aim at the area-weighted mean of the surrounding centroids; on a crease, at the mean of the neighbours on it.
        goal, normal, total = np.zeros(3), np.zeros(3), 0.0
        for i in range(count):
            q, r = c.points[c.origin[after(ring[i])]], c.points[c.origin[before(ring[i])]]
            if c.kind[v] == CREASE:
                if c.marked[ring[i]]:
                    normal += (q - p) * (1.0 if total == 0.0 else -1.0)
                    goal += q - p
                    total += 1.0
                continue
            vector = doubled_area_vector(p, q, r)
            normal += np.array(vector)
            area = length(vector)
            wanted = 0.5 * (c.length[c.origin[after(ring[i])]] + c.length[c.origin[before(ring[i])]])
            area /= max(wanted, 1e-300) ** 2
            goal += area * ((q + r) / 3 - 2 * p / 3)
            total += area
        size = np.sqrt((normal * normal).sum())
        if total == 0.0 or size == 0.0:
            continue

        # Move within the tangent plane, or along the crease.
        goal *= share / total
        normal /= size
        along = (goal * normal).sum()
        moved[v] += along * normal if c.kind[v] == CREASE else goal - along * normal
    c.points[:] = moved
