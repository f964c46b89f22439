"""Entries of a glTF document, with messages that say where a required key is missing."""

from typing import Any

from cascadenorm.errors import ReadError


def entry(document: dict[str, Any], name: str, number: Any, *keys: str) -> dict[str, Any]:
    """Return an entry of a list of a document. Raises ReadError if it does not exist or lacks one of the keys."""
    parts = document.get(name, [])
    if not isinstance(number, int) or not 0 <= number < len(parts):
        raise ReadError(f"the glTF document refers to {name}[{number!r}], which does not exist: export the file again")
    return with_keys(parts[number], f"{name}[{number}]", *keys)


def with_keys(part: Any, place: str, *keys: str) -> dict[str, Any]:
    """Return an object of a document, at a place such as accessors[0]. Raises ReadError if it lacks one of the keys."""
    if not isinstance(part, dict):
        raise ReadError(f"{place} in the glTF document is not an object: export the file again")
    missing = [key for key in keys if key not in part]
    if missing:
        raise ReadError(f"{place} in the glTF document has no {missing[0]!r}: export the file again")
    return part
