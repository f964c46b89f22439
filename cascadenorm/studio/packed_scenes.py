"""Scenes of the viewer as the bytes of a JSON file."""

import json
from collections.abc import Mapping
from typing import Any


def packed_scene(scene: Mapping[str, Any], *, faces: int | None = None) -> bytes:
    """Return the JSON of a scene, or of the part that completes one.

    `faces` is the number of faces of the mesh that coarse ones approximate, which the viewer then shows.
    """
    meshes = [mesh if faces is None else {**mesh, "faces": faces} for mesh in scene["meshes"]]
    return json.dumps({**scene, "meshes": meshes}, separators=(",", ":"), allow_nan=False).encode()
