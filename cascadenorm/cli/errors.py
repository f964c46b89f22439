"""Errors on the command line: one line on stderr, and an exit code by class."""

import errno
import sys

from cascadenorm.cli.options import spelled
from cascadenorm.errors import (
    CascadenormError,
    ConfigError,
    DenoiseError,
    MeshError,
    MissingDependencyError,
    OutputError,
    ParameterError,
    ReadError,
    WorkerError,
)

DONE, FAILED, USAGE, UNREADABLE, INVALID, OUTPUT, PARTLY, INTERRUPTED = 0, 1, 2, 3, 4, 5, 6, 130
"""Exit codes, as docs/json.md lists them."""

EXIT_CODES: dict[type[Exception], int] = {
    ParameterError: USAGE,
    ConfigError: USAGE,
    ReadError: UNREADABLE,
    MeshError: INVALID,
    OutputError: OUTPUT,
    DenoiseError: FAILED,
    WorkerError: FAILED,
    MissingDependencyError: FAILED,
}
"""Exit code of each class of error; the first that fits decides."""

LARGE_STRENGTH = 3.0
"""Strength above which a command warns."""

NO_SPACE = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO)


def exit_code(error: Exception) -> int:
    """Return the exit code that an error ends the command with."""
    if isinstance(error, OSError) and error.errno in NO_SPACE:
        return OUTPUT
    return next((code for kind, code in EXIT_CODES.items() if isinstance(error, kind)), FAILED)


def worded(error: Exception) -> str:
    """Return the message of an error, with options in the place of keyword arguments."""
    if isinstance(error, CascadenormError):
        return error.message(spelled)
    if isinstance(error, OSError) and error.errno in NO_SPACE:
        return f"the output cannot be written: {error.strerror}"
    if isinstance(error, MemoryError):
        return "there is not enough memory for this mesh"
    name = type(error).__name__
    return f"{name}: {error} (please report it; CASCADENORM_TRACEBACK=1 shows where it comes from)"


def located(name: str, error: Exception) -> str:
    """Return the message of an error after the name of the file that it is about, once."""
    message = worded(error)
    return message if message.startswith((name, repr(name))) else f"{name}: {message}"


def warn_of_strength(strength: float) -> None:
    """Say that a strength is unusually large."""
    if strength > LARGE_STRENGTH:
        complain(f"--strength {strength:g} removes shape as well as noise: 1 is usual, and more than 10 acts as 10")


def complain(message: str) -> None:
    """Print one line on stderr."""
    print(f"cascadenorm: {' '.join(message.split())}", file=sys.stderr)
