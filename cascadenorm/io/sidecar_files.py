"""Files that a mesh file names, textures say, taken along when it is written into another folder."""

from collections.abc import Iterable
from pathlib import Path

from cascadenorm.errors import OutputError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.references import content_beside, is_within

MOST_SHOWN = 80
"""Characters of a name that messages show."""


def sidecar_files(file: MeshFile, target: Path, *, force: bool) -> tuple[dict[Path, Iterable[Piece]], list[str]]:
    """Return what has to be written beside a target so that the file finds what it names.

    Parameters
    ----------
    file
        Names other files relative to its own folder.
    target
        Path of the output.
    force
        Other content may be replaced.

    Returns
    -------
    Contents by path, none if the target is in the folder of the file; and what was not found, or leads out of it

    Raises
    ------
    OutputError
        A file that is needed is missing, or its name leads out of the folder, or other content lies in the way and
        force is not given.
    """
    there = target.resolve().parent
    if file.folder is not None and file.folder.resolve() == there:
        return {}, []
    copies: dict[Path, Iterable[Piece]] = {}
    missing = []
    for name, needed in file.refers_to().items():
        content = content_beside(file.folder, name)
        outside = not is_within(name) or (content is not None and not (there / name).resolve().is_relative_to(there))
        if outside and needed:
            raise OutputError(
                f"the file references {_shown(name)}, which is outside its folder: write the output beside the input"
            )
        if content is None and needed:
            raise OutputError(f"the file references {_shown(name)}, which is missing or cannot be read: put it there")
        if outside or content is None:
            missing.append(f"the file {_shown(name)} that it references")
            continue
        copy = (there / name).resolve()
        if copy == target.resolve():
            raise OutputError(f"the file references another one named {copy.name!r}: choose another name")
        if content_beside(there, name) == content:
            continue
        if copy.exists() and not force:
            raise OutputError(
                f"{copy} exists already and differs from the referenced file {_shown(name)}",
                hint="choose another folder",
                remedy=("force", True),
            )
        copies[copy] = [content]
    return copies, missing


def _shown(name: str) -> str:
    """Return a name for messages, cut where it is long."""
    return repr(name if len(name) <= MOST_SHOWN else f"{name[:MOST_SHOWN]}…")
