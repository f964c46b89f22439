"""Decimated and remeshed scans, whose triangles no longer show how they were measured."""

from collections.abc import Callable

import numpy as np

from cascadenorm.data_gen.meshing.decimate import thinned
from cascadenorm.data_gen.meshing.remesh import remeshed
from cascadenorm.data_gen.meshing.surface import Extent
from cascadenorm.data_gen.scanning.isosurfaces import tetrahedral_surface
from cascadenorm.data_gen.scanning.measured import Measured, beneath
from cascadenorm.data_gen.scanning.points import reconstruction
from cascadenorm.data_gen.scanning.volumes import segmentation, tomogram
from cascadenorm.data_gen.shapes.fields import DistanceField

REMESHED = 0.3  # share of the scans that are remeshed instead of decimated


def retriangulated_scan(
    field: DistanceField, extent: Extent, *, faces: int, finer: float, level: float, rng: np.random.Generator
) -> Measured:
    """Decimate or remesh a mask, a tomogram or a surface from distances or points to about `faces` faces.

    Before that, it has about `finer` times as many faces. `level` is the level of its error. Raises UnfitShapeError if
    the scan or the mesh is invalid.
    """
    measure = MEASUREMENTS[rng.integers(len(MEASUREMENTS))]
    scan = measure(field, extent, faces=round(faces * finer), level=level, rng=rng).noisy
    if rng.random() < REMESHED:
        mesh = remeshed(scan, faces=faces, rounds=int(rng.integers(2, 6)))
    else:
        mesh = thinned(scan, faces=faces, evenness=float(10 ** rng.uniform(-7, -1)))
    return beneath(field, mesh, cell=scan.mean_edge_length)


def _binary_mask(
    field: DistanceField, extent: Extent, *, faces: int, level: float, rng: np.random.Generator
) -> Measured:
    return segmentation(field, extent, faces=faces, slices=False, rng=rng)


MEASUREMENTS: tuple[Callable[..., Measured], ...] = (
    tomogram, tomogram, tomogram, tomogram, reconstruction, reconstruction, reconstruction, _binary_mask, _binary_mask,
    tetrahedral_surface,
)  # fmt: skip
"""What is measured, drawn with equal chance. The steps of masks do not depend on the level."""
