"""Limits on the memory that the content of a file may need.

The limit is relative to the size of the file.
"""

import os

from cascadenorm.errors import ParameterError, ReadError

VARIABLE = "CASCADENORM_MAX_EXPANSION"
"""Environment variable that overrides EXPANSION."""
EXPANSION = 200.0
"""Largest expansion: bytes in memory per byte of a file. Compressed meshes reach 20."""
ALWAYS = 100_000_000
"""Bytes that a file of any size may expand to."""


def check_expansion(needed: float, size: int, what: str) -> None:
    """Raise ReadError if content needs more bytes of memory than a file of `size` bytes may expand to.

    `what` is the subject of the message, in the plural.
    """
    if needed > expansion_limit(size):
        raise ReadError(
            f"{what} need {needed / 1e6:,.0f} MB, more than {_expansion():g} times the size of the file",
            hint=f"if it can be trusted, set the environment variable {VARIABLE} to a larger number",
        )


def expansion_limit(size: int) -> float:
    """Return the number of bytes that a file of a given size may expand to."""
    return max(ALWAYS, _expansion() * size)


def _expansion() -> float:
    text = os.environ.get(VARIABLE, "") or str(EXPANSION)
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not value >= 1:
        raise ParameterError(f"the environment variable {VARIABLE} is {text!r}; it must be a number of at least 1")
    return value
