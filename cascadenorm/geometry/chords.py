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
    angles_between,
    kernel,
    parallel_for,
    scatter_add,
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
    cosines = np.empty(n)
    parallel_for(n, _cosine_range, mesh.vertices, mesh.faces, mesh.face_normals, around, cosines)
    cosines[topology.edges[topology.edge_faces.counts != 2]] = -1.0
    edges, pairs = (np.ascontiguousarray(x) for x in (topology.edges[topology.interior_edges], topology.face_pairs))
    out = np.empty((len(edges), 2))
    parallel_for(len(edges), _chord_range, mesh.vertices, mesh.faces, mesh.face_normals, edges, pairs, around, out)
    residuals, sagittas = np.ascontiguousarray(out.T)
    return Chords(residuals, sagittas, np.asarray((cosines[edges] >= SMOOTH).all(axis=1)))


def local_noise(mesh: Mesh, residuals: Floats) -> Floats:
    """Estimate the noise around each vertex: the RMS of the residuals of the chords within about four rings.

    Returns
    -------
    (n,) in the unit of the mesh; 0 for a vertex without an edge
    """
    topology, n = mesh.topology, len(mesh.vertices)
    ends = topology.edges[topology.interior_edges].ravel()
    each = np.repeat(residuals**2, 2)
    sums = scatter_add(ends, np.stack([each, np.ones_like(each)], axis=1), n)
    sums = averaged(sums, topology.vertex_neighbors, PASSES)
    return np.sqrt(np.divide(sums[:, 0], sums[:, 1], out=np.zeros(n), where=sums[:, 1] > 0))


def error_sums(part: Part, measured: Chords) -> dict[str, NDArray[Any]]:
    """Measure what `error_shares` takes of each component of a part, (c,).

    Parameters
    ----------
    measured : the chords of its mesh
    """
    mesh, own, count = part.mesh, part.interior_edges, len(part.components)
    rise, bent = _bends(mesh, own)
    first, second = mesh.topology.face_pairs[own].T
    label = mesh.topology.face_components[first]
    angle = angles_between(mesh.face_normals[first[bent]], mesh.face_normals[second[bent]])
    smooth = measured.smooth[own]
    squares = [scatter_add(label[smooth], values[own][smooth] ** 2, count) for values in measured[:2]]
    return {
        "bent": np.bincount(label[bent], minlength=count),
        "signed": scatter_add(label[bent], np.copysign(angle, rise[bent]), count),
        "angle": scatter_add(label[bent], angle, count),
        "smooth": np.bincount(label[smooth], minlength=count),
        "residuals": squares[0],
        "sagittas": squares[1],
    }


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
            _, bent = _bends(mesh, own)
            label = part.components[mesh.topology.face_components[mesh.topology.face_pairs[own, 0]]]
            chosen = bent & few[label]
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


def _bends(mesh: Mesh, own: Bools) -> tuple[Floats, Bools]:
    """Return how far the faces at some edges with two faces rise over each other, and whether they bend there.

    Where two do not bend, rounding may put the centroid of one off the plane of the other.
    """
    pairs = mesh.topology.face_pairs[own]
    first, second = pairs.T
    rise = rises(mesh, pairs)
    return rise, (np.abs(rise) > rounding(mesh)) & (mesh.areas[first] > 0) & (mesh.areas[second] > 0)


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
def _rise_range(start: int, stop: int, centroids: Vectors, normals: Vectors, pairs: Ints32, out: Floats) -> None:
    for i in range(start, stop):
        f, g = pairs[i]
        across, turn = subtract(row(centroids, g), row(centroids, f)), subtract(row(normals, f), row(normals, g))
        out[i] = dot(across, turn)


@kernel
def _cosine_range(
    start: int, stop: int, vertices: Vectors, faces: Ints32, normals: Vectors, around: Csr, out: Floats
) -> None:
    """Least cosine of the angle between the normal of a vertex and those of its faces; -1 where there is none."""
    for i in range(start, stop):
        mine = around.indices[around.indptr[i] : around.indptr[i + 1]]
        normal = _normal(vertices, faces, normals, mine, i, (0.0, 0.0, 0.0), 0.0)
        size = length(normal)
        out[i] = 1.0 if size > 0 else -1.0
        for f in mine:
            if size > 0:
                out[i] = min(out[i], dot(normal, row(normals, f)) / size)


@kernel
def _chord_range(
    start: int,
    stop: int,
    vertices: Vectors,
    faces: Ints32,
    normals: Vectors,
    edges: Ints32,
    pairs: Ints32,
    around: Csr,
    out: Floats,
) -> None:
    rises = np.empty(2)
    for e in range(start, stop):
        mean = add(row(normals, pairs[e, 0]), row(normals, pairs[e, 1]))
        least = SAME_SIDE * length(mean)
        step = subtract(row(vertices, edges[e, 1]), row(vertices, edges[e, 0]))
        for end in range(2):
            v = np.int64(edges[e, end])  # as in `_cosine_range`: a kernel is compiled for each type
            mine = around.indices[around.indptr[v] : around.indptr[v + 1]]
            normal = _normal(vertices, faces, normals, mine, v, mean, least)
            size = length(normal)
            rises[end] = dot(step, normal) / size if size > 0 else 0.0
        out[e, 0] = 0.5 * abs(rises[0] + rises[1])
        out[e, 1] = 0.5 * abs(rises[1] - rises[0])


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
