"""The textures that a library of materials of an OBJ file names."""

import os
import re
from pathlib import PurePath

OPTION = rb"-\w+(?:[ \t]+(?:on|off|[rgbmlz]|sphere|cube_\w+|[-+]?[\d.]+))*[ \t]+"
KEYWORD = rb"^[ \t]*(?:map_\w+|bump|disp|decal|refl|norm)[ \t]+"
TEXTURE_LINE = re.compile(KEYWORD + rb"(?:" + OPTION + rb")*([^\r\n]*\S)", re.M | re.I)


def textures(library: bytes, name: str) -> list[str]:
    """Return the names of textures, relative to what the name of the library itself is relative to."""
    found = {os.fsdecode(match[1]).replace("\\", "/") for match in TEXTURE_LINE.finditer(library)}
    return sorted((PurePath(name).parent / texture).as_posix() for texture in found)
