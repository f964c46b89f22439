"""Digests of files, which tell whether they are the same as before."""

import hashlib
from pathlib import Path

BLOCK = 1 << 20


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    found = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            found.update(block)
    return found.hexdigest()
