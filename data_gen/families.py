"""The families of shapes by name, so that some can be held out."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cascadenorm.data_gen.meshing.cad_tessellation import cad_part
from cascadenorm.data_gen.meshing.decimate import thinned
from cascadenorm.data_gen.meshing.modelled import modelled_mesh
from cascadenorm.data_gen.meshing.structured import structured_mesh, subdivided_cage, terrain_mesh
from cascadenorm.data_gen.meshing.surface import cut_out, extent_of, polygonised
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.scanning.isosurfaces import isosurface, tetrahedral_surface
from cascadenorm.data_gen.scanning.measured import Measured
from cascadenorm.data_gen.scanning.points import reconstruction
from cascadenorm.data_gen.scanning.retriangulated_scans import retriangulated_scan
from cascadenorm.data_gen.scanning.views import fused, scanned_view
from cascadenorm.data_gen.scanning.volumes import segmentation, tomogram
from cascadenorm.data_gen.shapes import cad, organic
from cascadenorm.data_gen.shapes.fields import DistanceField
from cascadenorm.data_gen.shapes.placement import log_uniform
from cascadenorm.data_gen.shapes.solids import engraved, polyhedron
from cascadenorm.mesh import Mesh

FINER = 3.0, 14.0  # ratio of the number of faces before decimation to that after it
FINER_SCANS = 1.4, 7.0  # the same for scans
COARSER = 1.0, 8.0  # size of the smallest details of a shape, in edges of the scan, before it is decimated or remeshed
COARSEST = 0.11  # largest size of such details
MOST_SCANNED = 40_000  # faces of a scan before decimation, unless the ratio would be below the smallest one
WIDEST_STEPS = 2.2  # largest ratio of the steps of a laser scanner
USUAL_AREA = 7.0  # area of a shape, which extends to about 1 from the origin

Shape = Callable[[float, np.random.Generator], DistanceField]
ErrorPart = Literal[
    "whole", "piece", "low-poly", "decimated", "view", "laser", "fused", "mask", "slices", "tomogram",
    "tetrahedra", "isosurface", "points", "retriangulated-scan", "tessellation", "structured", "terrain", "subdivided",
    "modelled",
]  # fmt: skip
"""What a mesh shows.

- "whole": the whole shape, which is closed.
- "piece": a piece cut out by a box.
- "low-poly": the whole shape decimated to few faces.
- "decimated": the same with detail far finer than the decimated mesh can represent.
- "view", "laser": what a depth camera or a laser scanner sees from one side.
- "fused": what several cameras see, fused in a volume.
- "mask", "slices": a meshed binary mask of voxels or of slices.
- "tomogram": a level of a tomogram.
- "tetrahedra": a noisy distance field meshed by marching tetrahedra.
- "isosurface": a level of an exact field, mostly with smooth relief.
- "points": the surface reconstructed from noisy points.
- "retriangulated-scan": a mask, tomogram or surface from distances or points, decimated or remeshed.
- "tessellation": faces of a CAD model, each triangulated.
- "structured": a surface over a grid of parameters.
- "terrain": heights over a grid.
- "subdivided": a subdivided cage of triangles.
- "modelled": a subdivided and sculpted cage of quadrilaterals.
"""


MEASUREMENTS: dict[ErrorPart, Callable[..., Measured]] = {
    "fused": fused, "tomogram": tomogram, "tetrahedra": tetrahedral_surface, "points": reconstruction,
}  # fmt: skip
MESHES: dict[ErrorPart, Callable[..., Mesh]] = {
    "tessellation": cad_part, "structured": structured_mesh, "terrain": terrain_mesh, "modelled": modelled_mesh,
}  # fmt: skip


@dataclass(frozen=True)
class ShapeFamily:
    """A family of random shapes."""

    # draws a field, given the expected edge length, below which detail would be lost; None for the parts in MESHES,
    # which are not made from a field
    shape: Shape | None
    weight: float  # how often the family is drawn, relative to the others
    sharp: bool  # whether edges of the shape become edges of the mesh
    part: ErrorPart = "whole"

    @property
    def measured(self) -> bool:
        """Whether the measurement itself produces the error, so that no noise is added."""
        return self.part in ("mask", "slices", "tomogram", "tetrahedra", "points", "retriangulated-scan")

    @property
    def seen(self) -> bool:
        """Whether the meshes show what cameras or laser scanners see."""
        return self.part in ("view", "laser", "fused")

    def make(self, *, faces: int, rng: np.random.Generator, level: float = 0.0) -> Measured:
        """Draw a shape and make a mesh of about `faces` faces. Raises UnfitShapeError if one of them is invalid.

        The level is that of the error of the cameras of a fused mesh, of the grain of a tomogram, of the distances of a
        tetrahedral mesh, or of the points of a reconstruction, also if they are decimated. Meshes of other families
        have no noise, and both meshes of the result are equal.
        """
        if self.shape is None:
            mesh = MESHES[self.part](faces=faces, rng=rng)
            return Measured.on_surface(mesh, mesh)
        area = USUAL_AREA * (0.25 if self.part == "piece" else 1.0)
        finer = log_uniform(FINER, rng=rng) if self.part == "decimated" else 1.0
        if self.part == "retriangulated-scan":
            finer = min(log_uniform(FINER_SCANS, rng=rng), max(MOST_SCANNED / faces, FINER_SCANS[0]))
        edge = float(np.sqrt(2.3 * area / (faces * finer)))
        if self.part == "retriangulated-scan":
            edge = max(edge, min(edge * log_uniform(COARSER, rng=rng), COARSEST))
        field = self.shape(edge, rng)
        extent = extent_of(field, rng=rng)
        if self.part in MEASUREMENTS:
            return MEASUREMENTS[self.part](field, extent, faces=faces, level=level, rng=rng)
        if self.part == "retriangulated-scan":
            return retriangulated_scan(field, extent, faces=faces, finer=finer, level=level, rng=rng)
        if self.part in ("mask", "slices"):
            return segmentation(field, extent, faces=faces, slices=self.part == "slices", rng=rng)
        if self.part in ("view", "laser"):
            ratio = log_uniform((1.0, WIDEST_STEPS), rng=rng) if self.part == "laser" else 1.0
            mesh = scanned_view(field, extent, faces=faces, rng=rng, ratio=ratio)
        elif self.part == "isosurface":
            mesh = isosurface(field, extent, faces=faces, rng=rng)
        elif self.part in ("low-poly", "decimated"):
            finer = finer if self.part == "decimated" else rng.uniform(2.5, 6)
            fine = polygonised(field, extent, faces=round(faces * finer), sharp=self.sharp, rng=rng)
            mesh = thinned(fine, faces=faces, evenness=float(10 ** rng.uniform(-7, -2)))
        elif self.part == "subdivided":
            fine = polygonised(field, extent, faces=faces, sharp=self.sharp, rng=rng)
            mesh = subdivided_cage(fine, faces=faces, rng=rng)
        else:
            if self.part == "piece":
                extent = cut_out(extent, share=rng.uniform(0.08, 0.4), rng=rng)
            mesh = tessellate(field, extent, faces=faces, sharp=self.sharp, rng=rng)
        return Measured.on_surface(mesh, mesh)


def any_of(*shapes: Shape) -> Shape:
    """Draw one of several kinds of shapes with equal chance."""
    return lambda edge, rng: shapes[rng.integers(len(shapes))](edge, rng)


MACHINED = any_of(cad.assembly, cad.bracket, cad.wheel, cad.turned, cad.plate, polyhedron, engraved)
GROWN = any_of(organic.statue, organic.bust, organic.bumpy, organic.rock, organic.creature)
SCENES = any_of(cad.tabletop, cad.tabletop, cad.assembly, cad.turned, GROWN)
OBJECTS = any_of(cad.tabletop, MACHINED, GROWN)

SHAPE_FAMILIES: dict[str, ShapeFamily] = {
    "assembly": ShapeFamily(cad.assembly, 1.2, sharp=True),
    "bracket": ShapeFamily(cad.bracket, 0.9, sharp=True),
    "wheel": ShapeFamily(cad.wheel, 0.9, sharp=True),
    "turned": ShapeFamily(cad.turned, 0.8, sharp=True),
    "plate": ShapeFamily(cad.plate, 0.9, sharp=True),
    "polyhedron": ShapeFamily(polyhedron, 0.9, sharp=True),
    "engraved": ShapeFamily(engraved, 0.9, sharp=True),
    "fan": ShapeFamily(cad.fan, 0.7, sharp=True),
    "creature": ShapeFamily(organic.creature, 0.7, sharp=False),
    "statue": ShapeFamily(organic.statue, 1.6, sharp=False),
    "mounted": ShapeFamily(organic.mounted, 0.6, sharp=True),
    "bust": ShapeFamily(organic.bust, 1.2, sharp=False),
    "bumpy": ShapeFamily(organic.bumpy, 0.9, sharp=False),
    "smooth": ShapeFamily(organic.smooth, 0.8, sharp=False),
    "rock": ShapeFamily(organic.rock, 0.7, sharp=False),
    "machined_piece": ShapeFamily(MACHINED, 1.8, sharp=True, part="piece"),
    "grown_piece": ShapeFamily(GROWN, 2.2, sharp=False, part="piece"),
    "view": ShapeFamily(SCENES, 0.9, sharp=True, part="view"),
    "fused": ShapeFamily(OBJECTS, 0.9, sharp=True, part="fused"),
    "laser": ShapeFamily(any_of(GROWN, GROWN, SCENES), 0.9, sharp=True, part="laser"),
    "low_poly": ShapeFamily(OBJECTS, 0.9, sharp=True, part="low-poly"),
    "decimated": ShapeFamily(any_of(GROWN, GROWN, OBJECTS), 0.9, sharp=True, part="decimated"),
    "subdivided": ShapeFamily(any_of(GROWN, OBJECTS), 0.9, sharp=True, part="subdivided"),
    "structured": ShapeFamily(None, 0.9, sharp=False, part="structured"),
    "terrain": ShapeFamily(None, 0.9, sharp=False, part="terrain"),
    "modelled": ShapeFamily(None, 0.9, sharp=False, part="modelled"),
    "segmentation": ShapeFamily(OBJECTS, 0.9, sharp=True, part="mask"),
    "slices": ShapeFamily(OBJECTS, 0.9, sharp=True, part="slices"),
    "tomogram": ShapeFamily(OBJECTS, 0.9, sharp=True, part="tomogram"),
    "tetrahedra": ShapeFamily(OBJECTS, 0.9, sharp=True, part="tetrahedra"),
    "isosurface": ShapeFamily(OBJECTS, 0.9, sharp=True, part="isosurface"),
    "points": ShapeFamily(OBJECTS, 0.9, sharp=True, part="points"),
    "retriangulated_scan": ShapeFamily(OBJECTS, 0.9, sharp=True, part="retriangulated-scan"),
    "cad_tessellation": ShapeFamily(None, 0.9, sharp=True, part="tessellation"),
}
