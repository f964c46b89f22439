"""Files that a mesh file references relative to its folder.

Files outside that folder are never read.
"""

import os
from pathlib import Path, PureWindowsPath


def is_within(name: str) -> bool:
    """Whether a relative name stays within its folder on every operating system."""
    path = PureWindowsPath(name)  # it recognises drives and both kinds of slashes
    depth = 0
    for part in path.parts:
        depth += -1 if part == ".." else 1
        if depth < 0:
            return False
    return depth > 0 and not path.anchor and "\0" not in name


def file_beside(folder: Path | None, name: str) -> Path | None:
    """Return the path of a referenced file; None if it is missing or outside the folder."""
    if folder is None or not is_within(name) or not os.path.isfile(folder / name):
        return None
    return folder / name


def content_beside(folder: Path | None, name: str) -> bytes | None:
    """Return the content of a referenced file; None if it is missing, outside the folder, or unreadable."""
    path = file_beside(folder, name)
    try:
        return None if path is None else path.read_bytes()
    except OSError:
        return None
