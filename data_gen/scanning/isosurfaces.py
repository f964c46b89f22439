"""Level surfaces of exact fields, meshed like measured volumes."""

import numpy as np

from cascadenorm.data_gen.meshing.polygonise import projected
from cascadenorm.data_gen.meshing.surface import Extent, disentangled
from cascadenorm.data_gen.scanning.tetrahedra import FACES_PER_VOXEL_SIDE, marching_tetrahedra
from cascadenorm.data_gen.scanning.volumes import (
    SMALLEST_COMPONENT,
    random_lattice,
    sampled,
    surface_nets,
    volume_surface,
)
from cascadenorm.data_gen.shapes.fields import DistanceField
from cascadenorm.mesh import Mesh

RELAXED_SHARE = 0.6  # share of the meshes whose vertices are moved onto the surface
MESHERS = {
    "cubes": (volume_surface, 3.0, 0.6),
    "nets": (surface_nets, 3.0, 0.2),
    "tetrahedra": (marching_tetrahedra, FACES_PER_VOXEL_SIDE, 0.2),
}
"""Function that meshes a volume, its number of faces per area of a voxel's side, and the share of meshes that use
it."""


def isosurface(field: DistanceField, extent: Extent, *, faces: int, rng: np.random.Generator) -> Mesh:
    """Mesh the level of an exact field, whose only error is the interpolation between the nodes of a lattice.

    The mesh has about `faces` faces. Raises UnfitShapeError if the field has no surface in the volume.
    """
    mesher, density, _ = MESHERS[str(rng.choice(list(MESHERS), p=[share for *_, share in MESHERS.values()]))]
    voxel = float(np.sqrt(density * extent.area / faces))
    nodes, axes = random_lattice(extent, np.full(3, voxel), rng=rng)
    mesh = mesher(0.5 - sampled(field, nodes) / voxel)
    placed = disentangled(Mesh(nodes[0, 0, 0] + mesh.vertices @ axes, mesh.faces), share=SMALLEST_COMPONENT)
    if rng.random() < RELAXED_SHARE:
        placed = placed.moved(projected(field, placed.vertices, size=0.3 * voxel))
    return placed
