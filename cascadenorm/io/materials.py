"""Textures that the material library of an OBJ file references."""

import os
import re
from pathlib import PurePath

OPTION = rb"-\w+(?:[ \t]+(?:on|off|[rgbmlz]|sphere|cube_\w+|[-+]?[\d.]+))*[ \t]+"
KEYWORD = rb"^[ \t]*(?:map_\w+|bump|disp|decal|refl|norm)[ \t]+"
TEXTURE_LINE = re.compile(KEYWORD + rb"(?:" + OPTION + rb")*([^\r\n]*\S)", re.M | re.I)


def textures(library: bytes, name: str) -> list[str]:
    """Return the names of textures, relative to the same folder as the name of the library."""
    found = {os.fsdecode(match[1]).replace("\\", "/") for match in TEXTURE_LINE.finditer(library)}
    return sorted((PurePath(name).parent / texture).as_posix() for texture in found)
