"""The families of shapes, by name, so that some can be held out."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cascadenorm.data_gen import cad, organic
from cascadenorm.data_gen.fields import Field
from cascadenorm.data_gen.manners import tessellate
from cascadenorm.data_gen.surface import extent_of
from cascadenorm.mesh import Mesh


@dataclass(frozen=True)
class Family:
    """Random shapes of one sort.

    Parameters
    ----------
    shape : draws a field
    weight : how often the family is drawn, relative to the others
    sharp : edges of the shape become edges of the mesh
    closed : meshes are watertight
    """

    shape: Callable[[np.random.Generator], Field]
    weight: float
    sharp: bool
    closed: bool = True

    def make(self, *, faces: int, rng: np.random.Generator) -> Mesh:
        """Draw a shape and make a mesh of about so many faces; UnfitShapeError if it came out bad."""
        field = self.shape(rng)
        extent = extent_of(field, rng=rng)
        return tessellate(field, extent, faces=faces, sharp=self.sharp, rng=rng)


FAMILIES: dict[str, Family] = {
    "assembly": Family(cad.assembly, 1.2, sharp=True),
    "bracket": Family(cad.bracket, 0.9, sharp=True),
    "wheel": Family(cad.wheel, 0.9, sharp=True),
    "turned": Family(cad.turned, 0.8, sharp=True),
    "plate": Family(cad.plate, 0.9, sharp=True),
    "polyhedron": Family(cad.polyhedron, 0.9, sharp=True),
    "engraved": Family(cad.engraved, 0.9, sharp=True),
    "fan": Family(cad.fan, 0.7, sharp=True),
    "creature": Family(organic.creature, 0.7, sharp=False),
    "statue": Family(organic.statue, 1.6, sharp=False),
    "bust": Family(organic.bust, 1.2, sharp=False),
    "bumpy": Family(organic.bumpy, 0.9, sharp=False),
    "smooth": Family(organic.smooth, 0.8, sharp=False),
    "rock": Family(organic.rock, 0.7, sharp=False),
}
