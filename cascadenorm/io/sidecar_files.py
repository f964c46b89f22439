"""Files within its folder that a mesh file references, such as textures, and copies of them for an output."""

import os
from collections.abc import Iterable
from pathlib import Path, PureWindowsPath
from urllib.parse import unquote, urlsplit

from cascadenorm.errors import OutputError
from cascadenorm.io.base import MeshFile, Piece


def is_scene(name: str) -> bool:
    """Whether a referenced file is an OpenUSD scene, which a batch denoises as well, so that it may already exist."""
    return name.lower().endswith((".usd", ".usda", ".usdc", ".usdz"))


def is_within(name: str) -> bool:
    """Whether a relative name stays within its folder on every operating system."""
    path = PureWindowsPath(name)  # it recognises drives and both kinds of slashes
    depth = 0
    for part in path.parts:
        depth += -1 if part == ".." else 1
        if depth < 0:
            return False
    return depth > 0 and not path.anchor and "\0" not in name


def relative_name(uri: str | None) -> str | None:
    """Return the file name of a URI relative to the document, or None if it does not denote such a file."""
    if uri is None:
        return None
    try:
        parts = urlsplit(uri)
    except ValueError:
        return None
    name = unquote(parts.path, errors="surrogateescape")
    absolute = parts.scheme or parts.netloc or name.startswith(("/", "\\")) or not name
    return None if absolute else name


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


MOST_SHOWN = 80  # number of characters of a name that messages show


def sidecar_files(file: MeshFile, target: Path, *, force: bool) -> tuple[dict[Path, Iterable[Piece]], list[str]]:
    """Return the files to write beside a target, so that the references of a file stay valid, as contents by path.

    There are none if the target is in the folder of the file. Returns as well the references that are missing or
    outside. Raises OutputError if a required file is missing or outside the folder, or if a file with other content
    exists and force is not given. An existing USD layer is kept, since it may be the result of the referenced one.
    """
    there = target.resolve().parent
    if file.folder is not None and file.folder.resolve() == there:
        return {}, []
    copies: dict[Path, Iterable[Piece]] = {}
    left_out = []
    for name, needed in file.refers_to().items():
        content, copy = content_beside(file.folder, name), copy_beside(target, name)
        if copy is None and needed:
            raise OutputError(
                f"the file references {_shown(name)}, which is outside its folder: write the output beside the input"
            )
        if content is None and needed:
            raise OutputError(f"the file references {_shown(name)}, which is missing or cannot be read: put it there")
        if copy is None or content is None:
            left_out.append(missing(name))
            continue
        if copy == target.resolve():
            raise OutputError(f"the file references another one named {copy.name!r}: choose another name")
        if content_beside(there, name) == content or (copy.exists() and is_scene(name)):
            continue
        if copy.exists() and not force:
            raise existing_copy(copy, name)
        copies[copy] = [content]
    return copies, left_out


def copy_beside(target: Path, name: str) -> Path | None:
    """Return where a referenced file is copied for a target; None if that is outside the folder of the target."""
    if not is_within(name):
        return None
    there = target.resolve().parent
    copy = (there / name).resolve()
    return copy if copy.is_relative_to(there) else None


def existing_copy(copy: Path, name: str) -> OutputError:
    """Return the error for a file with other content where a referenced one would be copied."""
    return OutputError(
        f"{copy} exists already and differs from the referenced file {_shown(name)}",
        hint="choose another folder",
        remedy=("force", True),
        existing=[name],
    )


def missing(name: str) -> str:
    """Return a referenced file that an output lacks, in words."""
    return f"the file {_shown(name)} that it references"


def _shown(name: str) -> str:
    """Return a name for messages, truncated if it is long."""
    return repr(name if len(name) <= MOST_SHOWN else f"{name[:MOST_SHOWN]}…")
