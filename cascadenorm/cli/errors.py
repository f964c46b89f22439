"""Print errors on one line of stderr and map them to exit codes."""

import errno
import math
import sys

from cascadenorm import errors
from cascadenorm.cli.options import setting_name

DONE, FAILED, USAGE, UNREADABLE, INVALID, OUTPUT, PARTLY, INTERRUPTED = 0, 1, 2, 3, 4, 5, 6, 130
"""Exit codes, as listed in docs/json.md."""

EXIT_CODES: dict[type[Exception], int] = {
    errors.ParameterError: USAGE,
    errors.ConfigError: USAGE,
    errors.ReadError: UNREADABLE,
    errors.MeshError: INVALID,
    errors.OutputError: OUTPUT,
    errors.DenoiseError: FAILED,
    errors.WorkerError: FAILED,
    errors.MissingDependencyError: FAILED,
}
"""Exit code of each error class; the first matching class applies."""

LARGE_STRENGTH = 3.0  # strength above which a command prints a warning

NO_SPACE = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO)


def exit_code(error: Exception) -> int:
    if isinstance(error, OSError) and error.errno in NO_SPACE:
        return OUTPUT
    return next((code for kind, code in EXIT_CODES.items() if isinstance(error, kind)), FAILED)


def worded(error: Exception) -> str:
    """Return the message of an error, with keyword arguments replaced by command line options."""
    if isinstance(error, errors.CascadenormError):
        return error.message(setting_name)
    if isinstance(error, OSError) and error.errno in NO_SPACE:
        return f"the output cannot be written: {error.strerror}"
    if isinstance(error, MemoryError):
        return "there is not enough memory"
    name = type(error).__name__
    return f"{name}: {error} (please report it; CASCADENORM_TRACEBACK=1 shows where it comes from)"


def located(name: str, error: Exception) -> str:
    """Return the message of an error, prefixed with the file name unless it already starts with it."""
    message = worded(error)
    return message if message.startswith((name, repr(name))) else f"{name}: {message}"


def warn_of_strength(strength: float) -> None:
    """Warn about an unusually large strength."""
    if LARGE_STRENGTH < strength < math.inf:  # infinity is refused
        notify(f"--strength {strength:g} removes shape as well as noise: 1 is usual, and more than 10 acts as 10")


def notify(message: str) -> None:
    """Print a message as one line on stderr."""
    print(f"cascadenorm: {' '.join(message.split())}", file=sys.stderr)
