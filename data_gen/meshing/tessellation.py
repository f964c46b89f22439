"""Tessellations: as polygonised, evenly or unevenly remeshed, stretched, subdivided."""

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.decimate import decimate
from cascadenorm.data_gen.meshing.half_edges import CORNER, SMOOTH, HalfEdges, half_edges_of, is_manifold, mesh_of
from cascadenorm.data_gen.meshing.polygonise import gradients, meeting_points, onto_surface
from cascadenorm.data_gen.meshing.remesh import SHORT, collapse_short, flip_edges, mend, slide, split_long
from cascadenorm.data_gen.meshing.surface import Extent, fit, polygonised
from cascadenorm.data_gen.shapes.fields import DistanceField
from cascadenorm.data_gen.shapes.patterns import noise
from cascadenorm.data_gen.shapes.placement import random_rotation
from cascadenorm.mesh import Mesh, Vectors, marked, unit

Tessellation = Literal["lattice", "even", "graded", "stretched", "subdivided", "jittered", "decimated"]


JUMP = 0.3  # least jump of the normal at an edge of a shape, in radians
ASTRAY = 0.006  # share of the faces that may deviate from the normal of the surface


def tessellate(
    field: DistanceField,
    extent: Extent,
    *,
    faces: int,
    sharp: bool,
    rng: np.random.Generator,
    tessellation: Tessellation | None = None,
) -> Mesh:
    """Make a mesh of about `faces` triangles of a field, whose edges become edges of the mesh if it is sharp.

    Without a tessellation, one is drawn.
    """
    if tessellation is None:
        tessellation = rng.choice(get_args(Tessellation), p=[0.15, 0.22, 0.17, 0.08, 0.08, 0.12, 0.18])
    coarse = faces // 4 if tessellation == "subdivided" else faces
    oversampling = {"lattice": 1.0, "decimated": float(rng.uniform(2, 3))}.get(tessellation, 2.5 if sharp else 1.3)
    if tessellation == "subdivided" and sharp:
        oversampling = 5.0
    lattice_faces = int(oversampling * coarse)
    mesh = polygonised(field, extent, faces=lattice_faces, sharp=sharp or rng.random() < 0.5, rng=rng)
    if not is_manifold(mesh):
        raise UnfitShapeError("the polygonised surface is not manifold")
    half_edges = half_edges_of(mesh, creases=shape_creases(field, mesh) if sharp else None)
    half_edges.length[:] = np.sqrt(4 / np.sqrt(3) * mesh.area / coarse)
    mend(half_edges)
    _TESSELLATIONS[tessellation](field, half_edges, rng)
    mend(half_edges)
    mesh = mesh_of(half_edges)
    if tessellation == "subdivided":
        half_edges = _halved(field, mesh, sharp=sharp)
        settle(field, half_edges)
        mend(half_edges)
        mesh = mesh_of(half_edges)
    fit(mesh)
    agreement = np.einsum("ij,ij->i", field_normals(field, mesh), mesh.face_normals)
    if np.mean(agreement < (0.5 if sharp else -0.2)) > ASTRAY:
        raise UnfitShapeError("too many faces do not follow the surface, which has features finer than the mesh")
    return mesh


def settle(field: DistanceField, half_edges: HalfEdges) -> None:
    """Move smooth vertices onto the surface, and crease and corner vertices onto its creases and corners."""
    n = half_edges.used[0]
    alive = half_edges.start[:n] >= 0
    free = alive & (half_edges.kind[:n] == SMOOTH)
    spacing = float(half_edges.length[0])
    half_edges.points[:n][free] = onto_surface(field, half_edges.points[:n][free], size=0.3 * spacing)

    faces = half_edges.origin[: 3 * half_edges.used[1]].reshape(-1, 3)
    faces = faces[faces[:, 0] >= 0]
    boundary = marked(half_edges.origin[(half_edges.twin == -1) & (half_edges.origin >= 0)], n)
    held = alive & (half_edges.kind[:n] != SMOOTH) & ~boundary
    face, corner = np.nonzero(held[faces])
    if len(face) == 0:
        return
    vertex = faces[face, corner]
    middle = half_edges.points[faces[face]].mean(axis=1)
    samples = onto_surface(field, 0.6 * half_edges.points[vertex] + 0.4 * middle, size=0.3 * spacing)
    normals = unit(gradients(field, samples, step=1e-4 * spacing))
    places, rank = meeting_points(samples, normals, vertex.astype(np.int64), n, reach=0.5 * spacing)
    moved = held & ((half_edges.kind[:n] != CORNER) | (rank == 3)) & (rank > 1)
    half_edges.points[:n][moved] = places[moved]


def shape_creases(field: DistanceField, mesh: Mesh) -> NDArray[np.bool_]:
    """Mark the edges of the mesh that lie on an edge of the shape, where the normal jumps within part of a triangle.

    A narrow fillet is therefore not marked, however much the mesh bends there.
    """
    inner, pairs = mesh.topology.interior_edges, mesh.topology.face_pairs.T
    bends = np.einsum("ij,ij->i", *mesh.face_normals[pairs]) < np.cos(0.5 * JUMP)
    edges, pairs = inner[bends], pairs[:, bends]
    middle = mesh.vertices[mesh.topology.edges[edges]].mean(axis=1)
    spacing = mesh.mean_edge_length
    beside = (0.7 * middle + 0.3 * mesh.centroids[pairs]).reshape(-1, 3)
    beside = onto_surface(field, beside, size=0.2 * spacing)
    normals = unit(gradients(field, beside, step=1e-3 * spacing)).reshape(2, -1, 3)
    creases = np.zeros(len(mesh.topology.edges), bool)
    creases[edges] = np.einsum("ij,ij->i", *normals) < np.cos(JUMP)
    return creases


def field_normals(field: DistanceField, mesh: Mesh) -> Vectors:
    """Return the normals of the surface at the points nearest to the face centroids."""
    spacing = mesh.mean_edge_length
    return unit(gradients(field, onto_surface(field, mesh.centroids, size=0.3 * spacing), step=1e-3 * spacing))


def _lattice(field: DistanceField, half_edges: HalfEdges, rng: np.random.Generator) -> None:
    """Keep the stairs and stripes of the lattice and remove only slivers."""
    collapse_short(half_edges, rng.uniform(0.25, 0.45))
    flip_edges(half_edges, rule="delaunay")
    for _ in range(rng.integers(0, 3)):
        slide(half_edges, rng.uniform(0.2, 0.6))
    settle(field, half_edges)


def _relaxed(field: DistanceField, half_edges: HalfEdges, rng: np.random.Generator, rounds: int) -> None:
    rule: Literal["valence", "delaunay"] = "valence" if rng.random() < 0.6 else "delaunay"
    for round_ in range(rounds):
        split_long(half_edges)
        collapse_short(half_edges, SHORT)
        flip_edges(half_edges, rule=rule)
        slide(half_edges, 0.6)
        if round_ >= rounds - 2:
            settle(field, half_edges)
            slide(half_edges, 0.4)
    collapse_short(half_edges, 0.3)
    flip_edges(half_edges, rule="delaunay")
    settle(field, half_edges)


def _even(field: DistanceField, half_edges: HalfEdges, rng: np.random.Generator) -> None:
    """Make nearly equilateral triangles of one size. Fewer rounds give less regular ones."""
    _relaxed(field, half_edges, rng, int(rng.integers(2, 6)))


def _graded(field: DistanceField, half_edges: HalfEdges, rng: np.random.Generator) -> None:
    """Make triangles whose size varies smoothly over the shape."""
    base = half_edges.length[0]
    drift = noise(wavelength=rng.uniform(0.2, 1.0), rng=rng)
    strength = rng.uniform(0.3, 0.9)
    for _ in range(2):
        half_edges.length[:] = base * np.exp(strength * drift(half_edges.points))
        _relaxed(field, half_edges, rng, 2)


def _stretched(field: DistanceField, half_edges: HalfEdges, rng: np.random.Generator) -> None:
    """Make triangles that are longer in one direction of space than across it."""
    turn = random_rotation(rng=rng)
    factors = np.exp(rng.uniform(-0.6, 0.6, 3))
    metric = turn @ np.diag(factors / factors.prod() ** (1 / 3)) @ turn.T
    inverse = np.linalg.inv(metric)
    half_edges.points[:] = half_edges.points @ metric
    _relaxed(lambda points: field(points @ inverse), half_edges, rng, int(rng.integers(2, 5)))
    half_edges.points[:] = half_edges.points @ inverse


def _jittered(field: DistanceField, half_edges: HalfEdges, rng: np.random.Generator) -> None:
    """Make even triangles, then move vertices randomly within the surface."""
    _relaxed(field, half_edges, rng, 3)
    free = np.flatnonzero(half_edges.kind == SMOOTH)
    amount = rng.uniform(0.08, 0.25) * half_edges.length[0]
    half_edges.points[free] += amount * rng.normal(size=(len(free), 3))
    settle(field, half_edges)
    flip_edges(half_edges, rule="delaunay")
    collapse_short(half_edges, 0.35)


def _decimated(field: DistanceField, half_edges: HalfEdges, rng: np.random.Generator) -> None:
    """Decimate a finer mesh into triangles of all shapes, larger where the surface is flat."""
    wanted = 4 / np.sqrt(3) * half_edges.length[0] ** -2 * mesh_of(half_edges).area
    collapse_short(half_edges, 0.2)
    flip_edges(half_edges, rule="delaunay")
    slide(half_edges, 0.5)
    settle(field, half_edges)
    decimate(half_edges, faces=int(wanted), evenness=float(10 ** rng.uniform(-4, -1)))
    if rng.random() < 0.7:
        flip_edges(half_edges, rule="delaunay")


def _halved(field: DistanceField, mesh: Mesh, *, sharp: bool) -> HalfEdges:
    """Insert a vertex on each edge and split each triangle into four."""
    edges, sides = mesh.topology.edges, mesh.topology.face_edges + len(mesh.vertices)
    vertices = np.concatenate([mesh.vertices, mesh.vertices[edges].mean(axis=1)])
    (a, b, c), (ab, bc, ca) = mesh.faces.T, sides.T
    faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    fine = Mesh(vertices, faces)
    creases = None
    if sharp:
        marked = np.flatnonzero(shape_creases(field, mesh))
        halves = edges[marked].astype(np.int64) * len(vertices) + (len(mesh.vertices) + marked)[:, None]
        creases = np.isin(fine.topology.edges.astype(np.int64) @ [len(vertices), 1], halves)
    half_edges = half_edges_of(fine, creases=creases, capacity=1.0)
    half_edges.length[:] = fine.mean_edge_length
    return half_edges


_TESSELLATIONS: dict[Tessellation, Callable[[DistanceField, HalfEdges, np.random.Generator], None]] = {
    "lattice": _lattice,
    "even": _even,
    "graded": _graded,
    "stretched": _stretched,
    "subdivided": _even,
    "jittered": _jittered,
    "decimated": _decimated,
}
