"""Copy referenced files, such as textures, to the folder of an output."""

from collections.abc import Iterable
from pathlib import Path

from cascadenorm.errors import OutputError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.references import content_beside, is_within

MOST_SHOWN = 80
"""Number of characters of a name that messages show."""


def sidecar_files(file: MeshFile, target: Path, *, force: bool) -> tuple[dict[Path, Iterable[Piece]], list[str]]:
    """Return the files to write beside a target, so that the references of a file stay valid, as contents by path.

    There are none if the target is in the folder of the file. Returns as well the references that are missing or
    outside. Raises OutputError if a required file is missing or outside the folder, or if a file with other content
    exists and force is not given.
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
    """Return a name for messages, truncated if it is long."""
    return repr(name if len(name) <= MOST_SHOWN else f"{name[:MOST_SHOWN]}…")
