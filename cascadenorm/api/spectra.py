"""Compute the Shape DNA of meshes and compare two shapes by it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cascadenorm.geometry.spectra.harmonics import Scale, shape_dna
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import Floats

EIGENVALUE_COUNT = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """The lowest eigenvalues of the Laplacian of one or two meshes.

    Parameters
    ----------
    scale
        Scaling of the eigenvalues, as in `shape_dna`.
    values
        (k,) ascending, in 1 / length², or dimensionless if multiplied by the area.
    other
        (k,) eigenvalues of the second mesh; None if there is none.
    """

    scale: Scale
    values: Floats
    other: Floats | None = None

    @property
    def distance(self) -> float | None:
        """Euclidean distance between the two spectra, 0 for isometric shapes; None for a single mesh."""
        return None if self.other is None else float(np.linalg.norm(self.values - self.other))


def spectrum(mesh: Any, other: Any = None, *, count: int = EIGENVALUE_COUNT, scale: Scale = "area") -> Spectrum:
    """Return the Shape DNA of a mesh and, for comparison, of a second one (Reuter, Wolter, Peinecke 2006).

    Parameters
    ----------
    mesh, other
        File paths, streams, or meshes of any library.
    count
        Number of eigenvalues, at most the number of vertices that a face references.
    scale
        "area" multiplies the eigenvalues by the area, which removes the effect of size; "keep" leaves them unchanged.

    Returns
    -------
    The eigenvalues of each mesh, (count,), and the distance between the two spectra.

    Raises
    ------
    MeshError
        A mesh is invalid. Its subclass ReadError is raised if a file cannot be read.
    ParameterError
        `count` is out of range, or `scale` is unknown.
    """
    first = shape_dna(as_mesh(mesh), count, scale=scale)
    second = None if other is None else shape_dna(as_mesh(other), count, scale=scale)
    return Spectrum(scale=scale, values=first, other=second)
