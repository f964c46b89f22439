"""Turn a field into a triangle mesh of a wanted size."""

from typing import NamedTuple

import numpy as np

from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.lattice import sample
from cascadenorm.data_gen.meshing.polygonise import NoSurfaceError, dual_contouring, marching_cubes
from cascadenorm.data_gen.meshing.untangle import untangled
from cascadenorm.data_gen.shapes.fields import DistanceField
from cascadenorm.data_gen.shapes.placement import random_rotation
from cascadenorm.mesh import Mesh, Vectors, part_of

HALF_SIDE = 1.6  # shapes are searched for in a cube with this half side
JITTER = 0.2  # largest random displacement of the nodes of a lattice, relative to their spacing
ROUGH = 0.09  # spacing of the coarse lattice of the first search


class Extent(NamedTuple):
    """Box around a shape and a first, coarse mesh of its surface; for a cut-out, the box and the part within it."""

    lower: Vectors
    upper: Vectors
    rough: Mesh

    @property
    def area(self) -> float:
        """Approximate area of the surface."""
        return self.rough.area

    @property
    def middle(self) -> Vectors:
        """Middle of the box."""
        return 0.5 * (self.lower + self.upper)


Window = tuple[Vectors, Vectors]
"""Lower and upper corner of a box."""


class UnfitShapeError(ValueError):
    """A random shape that is empty, not manifold, or otherwise invalid. Callers draw another one."""


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


def cut_out(extent: Extent, *, share: float, rng: np.random.Generator) -> tuple[Extent, Window]:
    """Choose a cube about a point of the surface that contains about a given share of its area."""
    rough = extent.rough
    middle = rough.centroids[rng.choice(len(rough.areas), p=rough.areas / rough.area)]
    gap = np.abs(rough.centroids - middle).max(axis=1)
    order = np.argsort(gap)
    half = float(gap[order[np.searchsorted(np.cumsum(rough.areas[order]), share * rough.area)]])
    window = (middle - half, middle + half)
    return Extent(*window, Mesh(rough.vertices, rough.faces[gap <= half])), window


def polygonised(field: DistanceField, extent: Extent, *, faces: int, sharp: bool, rng: np.random.Generator,
                window: Window | None = None) -> Mesh:  # fmt: skip
    """Polygonise a field with about `faces` triangles on a randomly rotated and jittered lattice.

    A sharp one is polygonised by dual contouring instead of marching cubes. A window is the box at which the surface is
    cut open.
    """
    spacing = float(np.sqrt(2.3 * extent.area / faces))
    lower, upper = (extent.lower, extent.upper) if window is None else window
    lattice = sample(
        field,
        lower=lower,
        upper=upper,
        spacing=spacing,
        jitter=JITTER,
        turn=random_rotation(rng=rng),
        open_boundary=window is not None,
        rng=rng,
    )
    try:
        mesh = dual_contouring(field, lattice) if sharp else marching_cubes(field, lattice)
    except NoSurfaceError as error:
        raise UnfitShapeError(str(error)) from error
    return largest_components(untangled(mesh), share=0.02)


def largest_components(mesh: Mesh, *, share: float) -> Mesh:
    """Drop components with less than a share of the faces of the largest one, and vertices without faces."""
    label = mesh.topology.face_components
    counts = np.bincount(label)
    return part_of(mesh, (counts >= share * counts.max())[label])[0]


def disentangled(mesh: Mesh, *, share: float) -> Mesh:
    """Return the largest components of a surface as a manifold; see `largest_components` and `untangled`."""
    return largest_components(untangled(largest_components(mesh, share=share)), share=share)


def fit(mesh: Mesh) -> None:
    """Raise UnfitShapeError if a mesh is not manifold or has degenerate faces."""
    if not is_manifold(mesh):
        raise UnfitShapeError("the mesh is not manifold")
    if mesh.areas.min() <= 1e-7 * mesh.areas.mean():
        raise UnfitShapeError("the mesh has faces without area")
