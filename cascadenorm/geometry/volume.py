"""Enclosed volumes of closed parts, and their restoration after displacements."""

from typing import NamedTuple

import numpy as np

from cascadenorm.mesh import Floats, Ints, Ints32, Mesh, Vectors, kernel, marked, parallel_for, scatter_add
from cascadenorm.mesh.vectors import cross, dot, row

NEWTON_STEPS = 20  # converges in about five; the volume is a cubic polynomial of the factor
CLOSED_TOLERANCE = 1e-13


class Parts(NamedTuple):
    """Connected components that enclose a volume."""

    number: Ints  # (n,) part of each vertex; -1 if its component is open or not consistently oriented
    total: int


def closed_parts(mesh: Mesh, *, may_touch: bool = False) -> Parts:
    """Find the components in which every edge has two faces that traverse it in opposite directions.

    If a component may touch itself along an edge, more such faces may meet there.
    """
    topology = mesh.topology
    open_edges = topology.balance != 0
    if not may_touch:
        open_edges |= topology.edge_faces.counts != 2
    component = topology.components
    closed = marked(component[mesh.faces[:, 0]], int(component.max()) + 1)
    closed[component[topology.edges[open_edges, 0]]] = False
    number = np.where(closed, np.cumsum(closed) - 1, -1)
    return Parts(number[component], int(closed.sum()))


def is_closed(mesh: Mesh) -> bool:
    """Return whether every face belongs to a closed part."""
    return bool((closed_parts(mesh).number[mesh.faces[:, 0]] >= 0).all())


def with_volume_of(original: Mesh, vertices: Vectors, *, weights: Floats) -> Vectors:
    """Restore the volume of each closed part by scaling (n, 3) vertices of the original mesh about their mean.

    The scaling has a weight, (n,), at each vertex; vertices with weight 0 stay in place. A part is unchanged if its
    volume is zero, has changed sign or cannot be restored.
    """
    parts = closed_parts(original)
    if parts.total == 0:
        return vertices.copy()
    inside = parts.number >= 0
    wanted = volumes(original, parts)
    arms = vertices - _centers(vertices, parts)
    pull = np.where(inside, weights, 0.0)[:, None] * arms
    usable = wanted * _volumes(original, arms, parts) > 0
    factor = np.zeros(parts.total)  # arms + factor * pull
    for _ in range(NEWTON_STEPS):
        stretched = arms + _each(factor, parts)[:, None] * pull
        missing = wanted - _volumes(original, stretched, parts)
        if (np.abs(missing) <= CLOSED_TOLERANCE * np.abs(wanted))[usable].all():
            break
        slope = _volume_slopes(original, stretched, pull, parts)
        factor += np.divide(missing, slope, out=np.zeros(parts.total), where=usable & (slope != 0))
    reached = usable & (np.abs(missing) <= 1e-10 * np.abs(wanted))
    return np.asarray(vertices + _each(np.where(reached, factor, 0.0), parts)[:, None] * pull)


def volumes(mesh: Mesh, parts: Parts) -> Floats:
    """Return the (total,) signed volume of each part; negative if the part is inside out."""
    return _volumes(mesh, mesh.vertices - _centers(mesh.vertices, parts), parts)


def _centers(vertices: Vectors, parts: Parts) -> Vectors:
    """Return the (n, 3) mean vertex of each vertex's part; zero outside the parts."""
    inside = parts.number >= 0
    counts = np.bincount(parts.number[inside], minlength=parts.total)
    sums = scatter_add(parts.number[inside], vertices[inside], parts.total)
    centers = np.zeros_like(vertices)
    centers[inside] = (sums / counts[:, None])[parts.number[inside]]
    return centers


def _each(values: Floats, parts: Parts) -> Floats:
    """Return the (n,) value of each vertex's part; zero outside the parts."""
    return np.where(parts.number >= 0, values[parts.number], 0.0)


def _volumes(mesh: Mesh, arms: Vectors, parts: Parts) -> Floats:
    """Return the signed volume of each part: a sixth of the sum of its corner determinants, relative to its centre."""
    determinants = np.empty(len(mesh.faces))
    parallel_for(len(determinants), _determinant_range, arms, mesh.faces, determinants)
    return _sums(mesh, determinants / 6, parts)


@kernel
def _determinant_range(start: int, stop: int, arms: Vectors, faces: Ints32, out: Floats) -> None:
    for f in range(start, stop):
        out[f] = dot(row(arms, faces[f, 0]), cross(row(arms, faces[f, 1]), row(arms, faces[f, 2])))


def _volume_slopes(mesh: Mesh, arms: Vectors, pull: Vectors, parts: Parts) -> Floats:
    """Return the derivative of the volume of each part as `arms` grow along `pull`."""
    a, b, c = np.moveaxis(arms[mesh.faces], 1, 0)
    u, v, w = np.moveaxis(pull[mesh.faces], 1, 0)
    change = np.einsum("ij,ij->i", u, np.cross(b, c))
    change += np.einsum("ij,ij->i", v, np.cross(c, a)) + np.einsum("ij,ij->i", w, np.cross(a, b))
    return _sums(mesh, change / 6, parts)


def _sums(mesh: Mesh, values: Floats, parts: Parts) -> Floats:
    number = parts.number[mesh.faces[:, 0]]
    return scatter_add(number[number >= 0], values[number >= 0], parts.total)
