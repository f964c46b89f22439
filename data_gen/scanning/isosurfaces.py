"""Level surfaces of exact fields, whose triangles are those of a measured volume although nothing was measured."""

import numpy as np

from cascadenorm.data_gen.meshing.polygonise import projected
from cascadenorm.data_gen.meshing.surface import Extent, largest_components
from cascadenorm.data_gen.meshing.untangle import untangled
from cascadenorm.data_gen.scanning.tetrahedra import FACES, marching_tetrahedra
from cascadenorm.data_gen.scanning.volumes import (
    SMALLEST,
    marching_cubes,
    random_lattice,
    sampled,
    surface_nets,
)
from cascadenorm.data_gen.shapes.fields import Field
from cascadenorm.mesh import Mesh

SETTLED = 0.6  # share of the meshes whose vertices are moved onto the surface
MESHERS = {
    "cubes": (marching_cubes, 3.0, 0.6),
    "nets": (surface_nets, 3.0, 0.2),
    "tetrahedra": (marching_tetrahedra, FACES, 0.2),
}
"""What meshes a volume, its faces for a surface whose area is that of a voxel's side, and its share."""


def isosurface(field: Field, extent: Extent, *, faces: int, rng: np.random.Generator) -> Mesh:
    """Mesh the level of a field without any error but that of the interpolation between the nodes of a lattice.

    Parameters
    ----------
    faces
        About so many, which give the edge of a voxel.

    Raises
    ------
    UnfitShapeError
        The field has no surface in the volume.
    """
    mesher, density, _ = MESHERS[str(rng.choice(list(MESHERS), p=[share for *_, share in MESHERS.values()]))]
    voxel = float(np.sqrt(density * extent.area / faces))
    nodes, axes = random_lattice(extent, np.full(3, voxel), rng=rng)
    mesh = mesher(0.5 - sampled(field, nodes) / voxel)
    placed = Mesh(nodes[0, 0, 0] + mesh.vertices @ axes, mesh.faces)
    placed = largest_components(untangled(largest_components(placed, share=SMALLEST)), share=SMALLEST)
    if rng.random() < SETTLED:
        placed = placed.moved(projected(field, placed.vertices, size=0.3 * voxel))
    return placed
