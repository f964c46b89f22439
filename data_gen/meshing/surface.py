"""From a field to a triangle mesh of a wanted size, tessellated as real meshes are."""

from typing import NamedTuple

import numpy as np

from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.lattice import sample
from cascadenorm.data_gen.meshing.polygonise import NoSurfaceError, dual_contouring, marching_cubes
from cascadenorm.data_gen.meshing.untangle import untangled
from cascadenorm.data_gen.shapes.fields import DistanceField
from cascadenorm.data_gen.shapes.placement import random_rotation
from cascadenorm.mesh import Mesh, Vectors, part_of

HALF_SIDE = 1.6  # shapes are looked for in a cube of this half side
ROUGH = 0.09  # spacing of the first look


class Extent(NamedTuple):
    """Box around a shape, and a first, coarse mesh of its surface (in one cut out: of the part within)."""

    lower: Vectors
    upper: Vectors
    rough: Mesh

    @property
    def area(self) -> float:
        """Area of the surface, nearly."""
        return self.rough.area

    @property
    def middle(self) -> Vectors:
        """Middle of the box."""
        return 0.5 * (self.lower + self.upper)


Window = tuple[Vectors, Vectors]
"""Lower and upper corner of a box."""


class UnfitShapeError(ValueError):
    """A random shape that came out empty, not manifold, or in another way not as wanted; draw another one."""


def extent_of(field: DistanceField, *, rng: np.random.Generator) -> Extent:
    """Look at a field coarsely."""
    lattice = sample(field, lower=[-HALF_SIDE] * 3, upper=[HALF_SIDE] * 3, spacing=ROUGH, rng=rng)
    inside = lattice.values < 0
    if not inside.any():
        raise UnfitShapeError("the shape is empty, or all thinner than the first look")
    where = lattice.nodes[inside]
    if np.abs(where).max() > HALF_SIDE - 2 * ROUGH:
        raise UnfitShapeError("the shape is too large")
    return Extent(where.min(axis=0) - ROUGH, where.max(axis=0) + ROUGH, marching_cubes(field, lattice))


def cut_out(extent: Extent, *, share: float, rng: np.random.Generator) -> tuple[Extent, Window]:
    """Choose a cube about a point of the surface that holds about a share of its area."""
    rough = extent.rough
    middle = rough.centroids[rng.choice(len(rough.areas), p=rough.areas / rough.area)]
    gap = np.abs(rough.centroids - middle).max(axis=1)
    order = np.argsort(gap)
    half = float(gap[order[np.searchsorted(np.cumsum(rough.areas[order]), share * rough.area)]])
    window = (middle - half, middle + half)
    return Extent(*window, Mesh(rough.vertices, rough.faces[gap <= half])), window


def polygonised(field: DistanceField, extent: Extent, *, faces: int, sharp: bool, rng: np.random.Generator,
                window: Window | None = None, relative_jitter: float = 0.2) -> Mesh:  # fmt: skip
    """Polygonise a field with about `faces` triangles on a lattice turned and jittered at random.

    Parameters
    ----------
    sharp
        Dual contouring, else marching cubes.
    window
        Corners of a box at which the surface is cut open; None for the whole shape.
    """
    spacing = float(np.sqrt(2.3 * extent.area / faces))
    lower, upper = (extent.lower, extent.upper) if window is None else window
    lattice = sample(
        field,
        lower=lower,
        upper=upper,
        spacing=spacing,
        jitter=relative_jitter,
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


def fit(mesh: Mesh) -> None:
    """Raise UnfitShapeError where a mesh is not manifold, or has faces without area."""
    if not is_manifold(mesh):
        raise UnfitShapeError("the mesh is not manifold")
    if mesh.areas.min() <= 1e-7 * mesh.areas.mean():
        raise UnfitShapeError("the mesh has faces without area")
