"""Shape DNA of meshes of any kind, and how far two shapes are from each other by it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from cascadenorm.geometry.spectra.harmonics import Scale, shape_dna
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import Floats, in_frame, without_lines

EIGENVALUE_COUNT = 50


@dataclass(frozen=True, kw_only=True)
class Spectrum:
    """The lowest eigenvalues of the Laplacian of one mesh or two.

    Parameters
    ----------
    scale
        As in `shape_dna`.
    values
        (k,) ascending, in 1 / length², or without a unit if they are multiplied by the area.
    other
        (k,) of the second mesh; None if there is none.
    """

    scale: Scale
    values: Floats
    other: Floats | None = None

    @property
    def distance(self) -> float | None:
        """Euclidean distance of the two spectra, 0 for isometric shapes; None for one mesh."""
        return None if self.other is None else float(np.linalg.norm(self.values - self.other))


def spectrum(mesh: Any, other: Any = None, *, count: int = EIGENVALUE_COUNT, scale: Scale = "area") -> Spectrum:
    """Return the shape DNA of a mesh, and of a second one to compare it with (Reuter, Wolter, Peinecke 2006).

    Parameters
    ----------
    mesh, other
        Path of a file, stream, or mesh of any library.
    count
        How many eigenvalues, at most the number of vertices that a face references.
    scale
        "area" multiplies eigenvalues by the area, so that size does not matter; "keep" leaves them as they are.

    Raises
    ------
    MeshError
        No valid mesh; its subclass ReadError where a file cannot be read.
    ParameterError
        Count is out of range.
    """
    first = _values(mesh, count, scale)
    return Spectrum(scale=scale, values=first, other=None if other is None else _values(other, count, scale))


def _values(source: Any, count: int, scale: Scale) -> Floats:
    framed, exponent = in_frame(without_lines(as_mesh(source)))
    values = shape_dna(framed, count, scale=scale)
    return values if scale == "area" else np.asarray(np.ldexp(values, -2 * exponent))
