"""Files that a mesh refers to, such as materials and textures, and their copies beside its result."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from cascadenorm import io
from cascadenorm.errors import OutputError
from cascadenorm.io.digests import file_digest
from cascadenorm.io.files import copied_names
from cascadenorm.io.sidecar_files import file_beside

Digests = Mapping[str, str | None]
"""Digests of referenced files by the names that a mesh has for them; None for those that were not copied."""


def copies_beside(names: Iterable[str], source: Path, output: Path) -> Digests:
    """Return the digests of the copies of referenced files beside a result, by their names.

    The digest of a copy, not that of its source, shows later whether the source has changed since it was copied.
    """
    return {name: _digest(output, name) if _digest(source, name) else None for name in names}


def are_current(copies: Digests, source: Path, output: Path) -> bool:
    """Test that the referenced files are those that were copied, and that the copies still exist."""
    return all(
        _digest(source, name) == digest and (digest is None or file_beside(output.parent, name) is not None)
        for name, digest in copies.items()
    )


def check_copies(copies: Digests, source: Path, output: Path) -> None:
    """Raise OutputError if a copy that has to be replaced was not written by a batch, or was changed since."""
    for name in copied_names(io.read(source), io.output_format(output)):
        present, new = _digest(output, name), _digest(source, name)
        if None not in (present, new) and present not in (new, copies.get(name)):
            raise OutputError(
                f"{output.parent / name} exists already and differs from the referenced file {name!r}",
                hint="choose another folder",
                remedy=("force", True),
                existing=[name],
            )


def _digest(mesh: Path, name: str) -> str | None:
    """Return the digest of a file that a mesh refers to; None if it is missing, unreadable or outside the folder."""
    path = file_beside(mesh.parent, name)
    try:
        return None if path is None else file_digest(path)
    except OSError:
        return None
