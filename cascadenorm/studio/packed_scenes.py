"""Scenes of the viewer as the bytes of a JSON file."""

import json
from collections.abc import Sequence

from cascadenorm.reports.given import Given
from cascadenorm.reports.scene import scene


def packed_scene(meshes: Sequence[Given], *, faces: int | None = None) -> bytes:
    """Return the scene of meshes.

    Parameters
    ----------
    faces : of the mesh that the given coarse ones approximate; the viewer then shows this number
    """
    packed = scene(meshes, [])
    if faces is not None:
        for mesh in packed["meshes"]:
            mesh["faces"] = faces
    return json.dumps(packed, separators=(",", ":"), allow_nan=False).encode()
