"""Faults of a surface that denoising may remove or make: counted before and after."""

from typing import NamedTuple

from cascadenorm.inspection.crossings import crossing_faces
from cascadenorm.inspection.defects import repeats, spikes
from cascadenorm.mesh import Mesh, in_frame

MOST_FACES_CROSSED = 200_000
"""Faces up to which those that cross are looked for unasked; it takes seconds for 100,000."""


class Faults(NamedTuple):
    """Counts of faults.

    Parameters
    ----------
    crossing_faces
        Number of faces that pass through others. None where that was not looked for.
    spikes
        Number of vertices that are spikes.
    """

    crossing_faces: int | None
    spikes: int


FAULTS = Faults._fields


def surface_faults(mesh: Mesh) -> Faults:
    """Count the faults of a mesh; crossing faces only in meshes of up to MOST_FACES_CROSSED."""
    small, _ = in_frame(mesh)
    crossing = None
    if len(mesh.faces) <= MOST_FACES_CROSSED:
        crossing = int(crossing_faces(small, repeats(small.vertices)[1]).sum())
    return Faults(crossing, int(spikes(small).sum()))
