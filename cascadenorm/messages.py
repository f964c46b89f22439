"""How numbers are said in messages."""


def counted(count: int, one: str, several: str = "") -> str:
    """Return a number with what it counts: of several what is given, or the word for one with an s."""
    return f"{count} {one if count == 1 else several or f'{one}s'}"
