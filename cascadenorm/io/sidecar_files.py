"""Files that a mesh file names, textures say, taken along when it is written into another folder."""

import os
from collections.abc import Iterable
from pathlib import Path

from cascadenorm.errors import OutputError
from cascadenorm.io.base import MeshFile, Piece


def sidecar_files(file: MeshFile, target: Path, *, force: bool) -> tuple[dict[Path, Iterable[Piece]], list[str]]:
    """Return what has to be written beside a target so that the file finds what it names.

    Parameters
    ----------
    file : names other files relative to its own folder
    target : path of the output
    force : other content may be replaced

    Returns
    -------
    Contents by path, none if the target is in the folder of the file; and what was not found, or leads out of it

    Raises
    ------
    OutputError : a name that the file needs leads out of its folder, or other content lies in the way and force is
        not given
    """
    there = target.resolve().parent
    if file.folder is not None and file.folder.resolve() == there:
        return {}, []
    copies: dict[Path, Iterable[Piece]] = {}
    missing = []
    for name, needed in file.refers_to().items():
        copy = (there / name).resolve()
        outside = not copy.is_relative_to(there)
        if outside and needed:
            raise OutputError(
                f"the file references {name!r}, which is outside its folder: write the output beside the input"
            )
        if outside or file.folder is None or not os.path.isfile(file.folder / name):
            missing.append(f"the file {name!r} that it references")
            continue
        content = (file.folder / name).read_bytes()
        if copy.exists() and copy.read_bytes() == content:
            continue
        if copy.exists() and not force:
            raise OutputError(
                f"{copy} exists already and differs from the referenced file {name!r}",
                hint="choose another folder",
                remedy=("force", True),
            )
        copies[copy] = [content]
    return copies, missing
