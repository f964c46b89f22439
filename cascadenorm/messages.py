"""Counts in messages."""


def counted(count: int, one: str, several: str = "") -> str:
    """Return a count with its noun; the plural is given, or the singular with an s."""
    return f"{count} {one if count == 1 else several or f'{one}s'}"
