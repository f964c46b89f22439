"""Count surface faults before and after denoising."""

from typing import NamedTuple

from cascadenorm.api.inspection.crossings import crossing_faces
from cascadenorm.api.inspection.defects import repeats, spikes
from cascadenorm.mesh import Mesh, in_frame

MOST_FACES_CROSSED = 200_000
"""Maximum number of faces of meshes that are checked for self-intersections by default."""


class Faults(NamedTuple):
    """Counts of faults."""

    crossing_faces: int | None  # number of faces that cross others; None if not checked
    spikes: int  # number of vertices that are spikes


FAULTS = Faults._fields


def surface_faults(mesh: Mesh) -> Faults:
    """Count the faults of a mesh; crossing faces are only counted in meshes of up to MOST_FACES_CROSSED faces."""
    small, _ = in_frame(mesh)
    crossing = None
    if len(mesh.faces) <= MOST_FACES_CROSSED:
        crossing = int(crossing_faces(small, repeats(small.vertices)[1]).sum())
    return Faults(crossing, int(spikes(small).sum()))
