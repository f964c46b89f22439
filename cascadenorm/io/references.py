"""Files that a mesh file references by names relative to its folder; nothing outside that folder is read."""

import os
from pathlib import Path, PureWindowsPath


def is_within(name: str) -> bool:
    """Whether a name, relative to a folder, stays in that folder, as any system reads it."""
    path = PureWindowsPath(name)  # which knows drives, and both kinds of slashes
    depth = 0
    for part in path.parts:
        depth += -1 if part == ".." else 1
        if depth < 0:
            return False
    return depth > 0 and not path.anchor and "\0" not in name


def file_beside(folder: Path | None, name: str) -> Path | None:
    """Return the path of a referenced file; None where it is missing, or its name leads out of the folder."""
    if folder is None or not is_within(name) or not os.path.isfile(folder / name):
        return None
    return folder / name


def content_beside(folder: Path | None, name: str) -> bytes | None:
    """Return the content of a referenced file; None where `file_beside` finds none, or it cannot be read."""
    path = file_beside(folder, name)
    try:
        return None if path is None else path.read_bytes()
    except OSError:
        return None
