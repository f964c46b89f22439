"""Turn a field into a triangle mesh of a wanted size."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.lattice import sample
from cascadenorm.data_gen.meshing.polygonise import dual_contouring, marching_cubes
from cascadenorm.data_gen.shapes.fields import DistanceField
from cascadenorm.data_gen.shapes.placement import random_rotation
from cascadenorm.mesh import Mesh, Vectors, part_of

HALF_SIDE = 1.6  # shapes are searched for in a cube with this half side
JITTER = 0.2  # largest random displacement of the nodes of a lattice, relative to their spacing
ROUGH = 0.09  # spacing of the coarse lattice of the first search
SMALLEST_COMPONENT = 0.05  # smaller components of measured surfaces, relative to the largest one, are dropped


class Extent(NamedTuple):
    """Box around a shape and a first, coarse mesh of its surface; for a cut-out, the box and the part within it."""

    lower: Vectors
    upper: Vectors
    rough: Mesh
    cut: bool = False  # whether the surface is cut open at the box

    @property
    def area(self) -> float:
        """Approximate area of the surface."""
        return self.rough.area

    @property
    def middle(self) -> Vectors:
        """Middle of the box."""
        return 0.5 * (self.lower + self.upper)


def extent_of(field: DistanceField, *, rng: np.random.Generator) -> Extent:
    """Sample a field coarsely."""
    lattice = sample(field, lower=[-HALF_SIDE] * 3, upper=[HALF_SIDE] * 3, spacing=ROUGH, rng=rng)
    inside = lattice.values < 0
    if not inside.any():
        raise UnfitShapeError("the shape is empty, or all thinner than the first look")
    where = lattice.nodes[inside]
    if np.abs(where).max() > HALF_SIDE - 2 * ROUGH:
        raise UnfitShapeError("the shape is too large")
    return Extent(where.min(axis=0) - ROUGH, where.max(axis=0) + ROUGH, marching_cubes(field, lattice))


def cut_out(extent: Extent, *, share: float, rng: np.random.Generator) -> Extent:
    """Choose a cube about a point of the surface that contains about a given share of its area."""
    rough = extent.rough
    middle = rough.centroids[rng.choice(len(rough.areas), p=rough.areas / rough.area)]
    gap = np.abs(rough.centroids - middle).max(axis=1)
    order = np.argsort(gap)
    half = float(gap[order[np.searchsorted(np.cumsum(rough.areas[order]), share * rough.area)]])
    return Extent(middle - half, middle + half, Mesh(rough.vertices, rough.faces[gap <= half]), cut=True)


def polygonised(field: DistanceField, extent: Extent, *, faces: int, sharp: bool, rng: np.random.Generator) -> Mesh:
    """Polygonise a field with about `faces` triangles on a randomly rotated and jittered lattice.

    A sharp one is polygonised by dual contouring instead of marching cubes.
    """
    spacing = float(np.sqrt(2.3 * extent.area / faces))
    lattice = sample(
        field,
        lower=extent.lower,
        upper=extent.upper,
        spacing=spacing,
        jitter=JITTER,
        turn=random_rotation(rng=rng),
        open_boundary=extent.cut,
        rng=rng,
    )
    mesh = dual_contouring(field, lattice) if sharp else marching_cubes(field, lattice)
    return largest_components(untangled(mesh), share=0.02)


def largest_components(mesh: Mesh, *, share: float) -> Mesh:
    """Drop components with less than a share of the faces of the largest one, and vertices without faces."""
    label = mesh.topology.face_components
    counts = np.bincount(label)
    return part_of(mesh, (counts >= share * counts.max())[label])[0]


def disentangled(mesh: Mesh) -> Mesh:
    """Return the largest components of a surface as a manifold; see `largest_components` and `untangled`."""
    larger = untangled(largest_components(mesh, share=SMALLEST_COMPONENT))
    return largest_components(larger, share=SMALLEST_COMPONENT)


def fit(mesh: Mesh) -> Mesh:
    """Return the mesh; raise UnfitShapeError if it is not manifold or has degenerate faces."""
    if not is_manifold(mesh):
        raise UnfitShapeError("the mesh is not manifold")
    if mesh.areas.min() <= 1e-7 * mesh.areas.mean():
        raise UnfitShapeError("the mesh has faces without area")
    return mesh


def untangled(mesh: Mesh) -> Mesh:
    """Give each pair of faces at an edge with four faces its own edge, and each fan of faces its own vertex."""
    mesh = _with_single_edges(mesh)
    fan = mesh.topology.fans(mesh.topology.edge_faces.counts == 2)
    vertices = np.empty((fan.max() + 1, 3))
    vertices[fan] = mesh.vertices[mesh.faces.ravel()]
    return Mesh(vertices, fan.reshape(-1, 3))


def _with_single_edges(mesh: Mesh) -> Mesh:
    """Give each pair of near faces at an edge with four faces a vertex of its own, slightly displaced towards them."""
    edge_faces = mesh.topology.edge_faces
    fresh: list[NDArray[np.float64]] = []
    inserted: dict[int, list[tuple[int, int]]] = {}  # face: (side, vertex)
    for edge in np.flatnonzero(edge_faces.counts == 4).tolist():
        a, b = mesh.topology.edges[edge]
        members = edge_faces.row(edge)
        sides = [int(np.flatnonzero(mesh.topology.face_edges[f] == edge)[0]) for f in members]
        ahead = [k for k in range(4) if mesh.faces[members[k], sides[k]] == a]
        back = [k for k in range(4) if k not in ahead]
        if len(ahead) != 2:
            continue
        middle = mesh.centroids[members]
        gap = np.linalg.norm(middle[ahead][:, None] - middle[back][None], axis=2)
        if gap[0, 0] + gap[1, 1] > gap[0, 1] + gap[1, 0]:
            back.reverse()
        for pair in zip(ahead, back, strict=True):
            place = 0.5 * (mesh.vertices[a] + mesh.vertices[b])
            place = place + 0.15 * (middle[list(pair)].mean(axis=0) - place)
            for k in pair:
                inserted.setdefault(int(members[k]), []).append((sides[k], len(mesh.vertices) + len(fresh)))
            fresh.append(place)
    pieces = [triangle for f, marks in inserted.items() for triangle in _pieces(mesh.faces[f], dict(marks))]
    if not pieces:
        return mesh
    kept = np.delete(mesh.faces, list(inserted), axis=0)
    return Mesh(np.concatenate([mesh.vertices, fresh]), np.concatenate([kept, np.array(pieces, np.int32)]))


def _pieces(face: NDArray[np.int32], marks: dict[int, int]) -> list[tuple[int, int, int]]:
    """Split a triangle that has new vertices on one, two or three of its sides."""
    outline: list[int] = []
    for side in range(3):
        outline.append(int(face[side]))
        if side in marks:
            outline.append(marks[side])
    new = set(marks.values())
    triangles = []
    while len(outline) > 3:  # clip an old corner between two vertices, at least one of which is new
        k = next(
            i
            for i in range(len(outline))
            if outline[i] not in new and (outline[i - 1] in new or outline[(i + 1) % len(outline)] in new)
        )
        triangles.append((outline[k - 1], outline[k], outline[(k + 1) % len(outline)]))
        del outline[k]
    return [*triangles, (outline[0], outline[1], outline[2])]
