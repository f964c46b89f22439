"""The textures that a library of materials of an OBJ file names."""

import os
import re
from pathlib import PurePath

OPTION = rb"-\w+(?:\s+(?:on|off|[rgbmlz]|sphere|cube_\w+|[-+]?[\d.]+))*\s+"
TEXTURE = re.compile(rb"^[ \t]*(?:map_\w+|bump|disp|decal|refl|norm)\s+(?:" + OPTION + rb")*([^\r\n]*\S)", re.M | re.I)


def textures(library: bytes, name: str) -> list[str]:
    """Return the names of textures, relative to what the name of the library itself is relative to."""
    found = {os.fsdecode(match[1]).replace("\\", "/") for match in TEXTURE.finditer(library)}
    return sorted((PurePath(name).parent / texture).as_posix() for texture in found)
