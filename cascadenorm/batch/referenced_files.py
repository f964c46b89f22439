"""Files that a mesh refers to, such as materials and textures, and their copies beside its result."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from cascadenorm import io
from cascadenorm.io.digests import file_digest
from cascadenorm.io.files import copied_names
from cascadenorm.io.sidecar_files import copy_beside, existing_copy, file_beside

Digests = Mapping[str, str | None]
"""Digests of referenced files by the names that a mesh has for them; None for those that were not copied."""


def copies_beside(names: Iterable[str], source: Path, output: Path) -> Digests:
    """Return the digests of the copies of referenced files beside a result, by their names.

    The digest of a copy, not that of its source, shows later whether the source has changed since it was copied.
    """
    return {name: _of_copy(output, name) if _of_source(source, name) else None for name in names}


def are_current(copies: Digests, source: Path, output: Path) -> bool:
    """Test that the referenced files are those that were copied, and that the copies still exist."""
    return all(
        _of_source(source, name) == digest and (digest is None or _of_copy(output, name) is not None)
        for name, digest in copies.items()
    )


def check_copies(copies: Digests, source: Path, output: Path) -> None:
    """Raise OutputError if a copy that has to be replaced was not written by a batch, or was changed since."""
    for name in copied_names(io.read(source), output):
        present, new = _of_copy(output, name), _of_source(source, name)
        if None not in (present, new) and present not in (new, copies.get(name)):
            raise existing_copy(output.parent / name, name)


def _of_source(source: Path, name: str) -> str | None:
    """Return the digest of a file that a mesh refers to; None if it is missing, unreadable or outside its folder."""
    return _digest(file_beside(source.parent, name))


def _of_copy(output: Path, name: str) -> str | None:
    """Return the digest of its copy for a result; None if it is missing, unreadable or outside its folder."""
    return _digest(copy_beside(output, name))


def _digest(path: Path | None) -> str | None:
    try:
        return file_digest(path) if path is not None and path.is_file() else None
    except OSError:
        return None
