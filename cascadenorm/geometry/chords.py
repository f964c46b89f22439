"""Edges against the normals at their ends: a chord of a smooth surface makes the same angle with both, noise does not.

For an edge from x_i to x_j and unit vertex normals, the sagitta <x_j - x_i, n_j - n_i>/2 is what the surface bends, and
the residual <x_j - x_i, n_i + n_j>/2 is error: it vanishes on spheres and cylinders, however they are triangulated, and
is of third order in the length of the edge on any smooth surface.
"""

import math
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.geometry.averages import averaged
from cascadenorm.geometry.parts import AT_ONCE, Found, Part, Surface, nth
from cascadenorm.geometry.rounding import rounding
from cascadenorm.mesh import (
    Bools,
    Csr,
    Floats,
    Index,
    Ints,
    Ints32,
    Mesh,
    Vectors,
    kernel,
    parallel_for,
    sums_in_blocks,
)
from cascadenorm.mesh.vectors import Vector, add, cross, dot, length, row, subtract

RINGS = 3  # edges around a vertex that the chords of its edges depend on
PASSES = 8  # averages over neighbours that a noise estimate is taken from: about four rings
FEWEST = 150  # edges that bend, or join smooth vertices, of a component from which a share of error is taken
SMOOTH = 0.5 * math.sqrt(3)
"""Cosine, 30°, of the largest angle between a vertex normal and a face around it where the surface is smooth."""
SAME_SIDE = 0.5
"""Cosine, 60°, of the angle to the mean normal of an edge up to which faces at its ends are on its side of a crease."""


class Chords(NamedTuple):
    """Of each edge with two faces, (i,): absolute residual, absolute sagitta, and whether both ends are smooth."""

    residuals: Floats
    sagittas: Floats
    smooth: Bools


def chords(mesh: Mesh) -> Chords:
    """Measure each edge that has two faces against the normals at its ends, those of this side at a crease.

    A normal is the mean of faces by their area over the squared lengths of the two sides that meet in the vertex, which
    is exact on spheres (Max 1999).
    """
    topology, n = mesh.topology, len(mesh.vertices)
    around = topology.vertex_faces
    whole, cosines = np.empty((n, 3)), np.empty(n)
    parallel_for(n, _vertex_range, mesh.vertices, mesh.faces, mesh.face_normals, around, whole, cosines)
    cosines[topology.edges[topology.edge_faces.counts != 2]] = -1.0
    interior = topology.interior_edges
    out = Chords(np.empty(len(interior)), np.empty(len(interior)), np.empty(len(interior), bool))
    parallel_for(
        len(interior), _chord_range, mesh.vertices, mesh.faces, mesh.face_normals, topology.edges, interior,
        topology.face_pairs, around, whole, cosines, *out,
    )  # fmt: skip
    return out


def local_noise(mesh: Mesh, residuals: Floats) -> Floats:
    """Estimate the noise around each vertex: the RMS of the residuals of the chords within about four rings.

    Returns
    -------
    (n,) in the unit of the mesh; 0 for a vertex without an edge
    """
    topology, n = mesh.topology, len(mesh.vertices)
    sums = np.zeros((n, 2))
    _add_squares(residuals, topology.edges, topology.interior_edges, sums)
    sums = averaged(sums, topology.vertex_neighbors, PASSES)
    return np.sqrt(np.divide(sums[:, 0], sums[:, 1], out=np.zeros(n), where=sums[:, 1] > 0))


def error_sums(part: Part, measured: Chords) -> dict[str, NDArray[Any]]:
    """Measure what `error_shares` takes of each component of a part, (c,).

    Parameters
    ----------
    measured : the chords of its mesh
    """
    mesh, topology, own = part.mesh, part.mesh.topology, part.interior_edges
    pairs, component, limit = topology.face_pairs, topology.face_components, rounding(mesh)

    def add(start: int, stop: int, sums: Floats) -> None:
        _error_range(
            start, stop, own, pairs, component, mesh.centroids, mesh.face_normals, mesh.areas, limit, *measured, sums
        )

    names = "edges", "bent", "smooth", "signed", "angle", "residuals", "sagittas"
    sums = dict(zip(names, sums_in_blocks(len(own), (len(part.components), len(names)), add).T, strict=True))
    return {**sums, **{name: sums[name].astype(np.int64) for name in names[:3]}}


def error_shares(surface: Surface, sums: Found, measured: Chords | None = None) -> Floats:
    """Residual of the chords over their sagitta, plus 1 - |Σ bend| / Σ |bend|, of each component, (count,).

    The bend of an edge is the angle between its faces, negative where it is convex. Residual and sagitta are root mean
    squares over the edges between smooth vertices; where there are few of these, medians over all that bend.
    Infinite for components with few edges that bend.

    Parameters
    ----------
    sums : what `error_sums` gave, over all parts
    measured : the chords, where the surface is a mesh in memory and they are known
    """
    enough, many = sums["bent"] >= FEWEST, sums["smooth"] >= FEWEST
    share = np.full(len(enough), np.inf)
    if not enough.any():
        return share
    cancelled = 1 - np.abs(sums["signed"]) / np.maximum(sums["angle"], np.finfo(float).tiny)
    error, bend = np.sqrt(sums["residuals"]), np.sqrt(sums["sagittas"])
    few = enough & ~many
    if few.any():

        def chords_of_few(part: Part) -> Found:
            mesh, own = part.mesh, part.interior_edges
            pairs = mesh.topology.face_pairs[own]
            label = part.components[mesh.topology.face_components[pairs[:, 0]]]
            chosen = _bent(mesh, pairs) & few[label]
            residuals, sagittas, _ = measured or chords(mesh)
            return {"label": label[chosen], "error": residuals[own][chosen], "bend": sagittas[own][chosen]}

        parts = surface.each("chords", RINGS, chords_of_few)
        error[few], bend[few] = (
            _medians(parts, name, np.where(few, sums["bent"], 0))[few] for name in ("error", "bend")
        )
    known = enough & (bend > 0)
    share[known] = error[known] / bend[known] + cancelled[known]
    return share


def rises(mesh: Mesh, pairs: Ints32) -> Floats:
    """Return (k,) how far the centroids of the two faces of each pair rise over each other's planes, together.

    It is negative where they meet in a convex edge.
    """
    out = np.empty(len(pairs))
    parallel_for(len(out), _rise_range, mesh.centroids, mesh.face_normals, pairs, out)
    return out


def _bent(mesh: Mesh, pairs: Ints32) -> Bools:
    """Tell of pairs of faces at an edge, (k, 2), whether they bend there.

    Where two do not bend, rounding may put the centroid of one off the plane of the other.
    """
    first, second = pairs.T
    off = np.abs(rises(mesh, pairs)) > rounding(mesh)
    return np.asarray(off & (mesh.areas[first] > 0) & (mesh.areas[second] > 0))


def _values_of(parts: Iterable[tuple[Ints, Found]], name: str, component: Index) -> Iterator[Floats]:
    """Return the values of one component, part by part."""
    for _, found in parts:
        yield found[name][found["label"] == component]


def _medians(parts: Iterable[tuple[Ints, Found]], name: str, sizes: Ints) -> Floats:
    """Upper median of the values of each component, (c,); 0 where it has none.

    Parameters
    ----------
    sizes : (c,) how many it has; those of components with few are held in memory, some AT_ONCE values at a time
    """
    out, large = np.zeros(len(sizes)), sizes > AT_ONCE
    for one in np.flatnonzero(large):
        out[one] = nth(partial(_values_of, parts, name, one), int(sizes[one]) // 2)
    group = (np.cumsum(np.where(large, 0, sizes)) - sizes) // AT_ONCE
    for number in np.unique(group[(sizes > 0) & ~large]).tolist():
        mine = np.flatnonzero((group == number) & (sizes > 0) & ~large)
        chosen = np.isin(np.arange(len(sizes)), mine)
        rows = [(found["label"][its], found[name][its]) for _, found in parts for its in [chosen[found["label"]]]]
        label, values = (np.concatenate(columns) for columns in zip(*rows, strict=True))
        ordered = values[np.lexsort((values, label))]
        ends = np.cumsum(sizes[mine])
        out[mine] = ordered[ends - sizes[mine] + sizes[mine] // 2]
    return out


@kernel
def _rise(centroids: Vectors, normals: Vectors, f: Index, g: Index) -> float:
    """See `rises`."""
    across, turn = subtract(row(centroids, g), row(centroids, f)), subtract(row(normals, f), row(normals, g))
    rise: float = dot(across, turn)
    return rise


@kernel
def _rise_range(start: int, stop: int, centroids: Vectors, normals: Vectors, pairs: Ints32, out: Floats) -> None:
    for i in range(start, stop):
        out[i] = _rise(centroids, normals, pairs[i, 0], pairs[i, 1])


@kernel
def _error_range(
    start: int,
    stop: int,
    own: Bools,
    pairs: Ints32,
    component: Ints32,
    centroids: Vectors,
    normals: Vectors,
    areas: Floats,
    limit: float,
    residuals: Floats,
    sagittas: Floats,
    smooth: Bools,
    sums: Floats,
) -> None:
    """Add to the sums of each component what `error_sums` names, over its own edges."""
    for e in range(start, stop):
        if not own[e]:
            continue
        f, g = pairs[e]
        c = component[f]
        sums[c, 0] += 1

        # faces that bend (see `_bent`), by an angle that is negative where they are convex
        rise = _rise(centroids, normals, f, g)
        if abs(rise) > limit and areas[f] > 0 and areas[g] > 0:
            one, other = row(normals, f), row(normals, g)
            angle = 2 * np.arctan2(length(subtract(one, other)), length(add(one, other)))
            sums[c, 1] += 1
            sums[c, 3] += np.copysign(angle, rise)
            sums[c, 4] += angle

        # chords between smooth vertices
        if smooth[e]:
            sums[c, 2] += 1
            sums[c, 5] += residuals[e] * residuals[e]
            sums[c, 6] += sagittas[e] * sagittas[e]


@kernel
def _add_squares(residuals: Floats, edges: Ints32, interior: Ints32, sums: Floats) -> None:
    """Add to both ends of each edge with two faces the square of its residual, and 1."""
    for e in range(len(interior)):
        for end in range(2):
            v = edges[interior[e], end]
            sums[v, 0] += residuals[e] * residuals[e]
            sums[v, 1] += 1


@kernel
def _vertex_range(
    start: int,
    stop: int,
    vertices: Vectors,
    faces: Ints32,
    normals: Vectors,
    around: Csr,
    whole: Vectors,
    cosines: Floats,
) -> None:
    """Sum of the weighted normals of all faces around a vertex, and the least cosine of an angle between it and theirs.

    The cosine is -1 where the sum vanishes.
    """
    for i in range(start, stop):
        mine = around.indices[around.indptr[i] : around.indptr[i + 1]]
        normal = _normal(vertices, faces, normals, mine, i, (0.0, 0.0, 0.0), 0.0)
        whole[i, 0], whole[i, 1], whole[i, 2] = normal
        size = length(normal)
        cosines[i] = 1.0 if size > 0 else -1.0
        for f in mine:
            if size > 0:
                cosines[i] = min(cosines[i], dot(normal, row(normals, f)) / size)


@kernel
def _chord_range(
    start: int,
    stop: int,
    vertices: Vectors,
    faces: Ints32,
    normals: Vectors,
    edges: Ints32,
    interior: Ints32,
    pairs: Ints32,
    around: Csr,
    whole: Vectors,
    cosines: Floats,
    residuals: Floats,
    sagittas: Floats,
    smooth: Bools,
) -> None:
    rises = np.empty(2)
    for i in range(start, stop):
        mean = add(row(normals, pairs[i, 0]), row(normals, pairs[i, 1]))
        least = SAME_SIDE * length(mean)
        ends = edges[interior[i]]
        step = subtract(row(vertices, ends[1]), row(vertices, ends[0]))

        # the normal at either end, of all faces around it but those beyond a crease
        for end in range(2):
            v = np.int64(ends[end])  # as in `_vertex_range`: a kernel is compiled for each type
            first, last, beyond = around.indptr[v], around.indptr[v + 1], 0
            for k in range(first, last):
                beyond += dot(row(normals, around.indices[k]), mean) < least
            normal = row(whole, v)
            if beyond > 0:
                normal = _normal(vertices, faces, normals, around.indices[first:last], v, mean, least)
            size = length(normal)
            rises[end] = dot(step, normal) / size if size > 0 else 0.0

        residuals[i] = 0.5 * abs(rises[0] + rises[1])
        sagittas[i] = 0.5 * abs(rises[1] - rises[0])
        smooth[i] = cosines[ends[0]] >= SMOOTH and cosines[ends[1]] >= SMOOTH


@kernel
def _normal(
    vertices: Vectors, faces: Ints32, normals: Vectors, mine: Ints32, v: Index, direction: Vector, least: float
) -> Vector:
    """Sum of the weighted normals of the faces around a vertex, of those that go along a direction by so much."""
    x = y = z = 0.0
    for f in mine:
        n = row(normals, f)
        if dot(n, direction) < least:
            continue
        a, b, c = faces[f]
        while a != v:
            a, b, c = b, c, a
        one, other = subtract(row(vertices, b), row(vertices, a)), subtract(row(vertices, c), row(vertices, a))
        squares = dot(one, one) * dot(other, other)
        weight = length(cross(one, other)) / squares if squares > 0 else 0.0
        x, y, z = x + weight * n[0], y + weight * n[1], z + weight * n[2]
    return x, y, z
