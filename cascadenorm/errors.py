"""Every error that the package raises on purpose, with what a front end needs to word it for its own users.

The text of an error is written for callers in Python. A front end with other names for the same settings, such as the
command line, passes its own spelling to `message`.
"""

from collections.abc import Callable, Sequence
from copy import copy
from typing import TypeVar

Located = TypeVar("Located", bound="CascadenormError")

Spelling = Callable[[str, object], str]
"""What an interface calls a setting, given its name in Python, and None or the value to be set."""


def in_python(name: str, value: object = None) -> str:
    """Spell a setting as a keyword argument."""
    return name if value is None else f"{name}={value!r}"


class CascadenormError(Exception):
    """Any of the errors below.

    Parameters
    ----------
    problem
        What is wrong, with the value and the place.
    hint
        The way out.
    remedy
        Name and value of a setting that is another way out, such as ("force", True).

    Attributes
    ----------
    place
        Name of the file or stream that the problem is in, empty if there is none.
    """

    def __init__(self, problem: str = "", *, hint: str = "", remedy: tuple[str, object] | None = None) -> None:
        super().__init__(problem)
        self.problem, self.hint, self.remedy, self.place = problem, hint, remedy, ""

    def message(self, spelling: Spelling = in_python) -> str:
        """Return place, problem and ways out as one sentence, with settings in the spelling of an interface."""
        ways = [self.hint] if self.hint else []
        if self.remedy:
            ways.append(f"pass {spelling(*self.remedy)}")
        place = f"{self.place}: " if self.place else ""
        return f"{place}{self._stated(spelling)}{': ' if ways else ''}{', or '.join(ways)}"

    def within(self: Located, place: str) -> Located:
        """Return the same error with the name of the file that it is about."""
        located = copy(self)
        located.place = place
        return located

    def __str__(self) -> str:
        return self.message()

    def _stated(self, spelling: Spelling) -> str:
        return self.problem


class MeshError(CascadenormError, ValueError):
    """A mesh that cannot be processed."""


class ReadError(MeshError):
    """A file that cannot be read as a mesh."""


class ParameterError(CascadenormError, ValueError):
    """An unknown method, parameter or control, or a value that is out of range.

    Parameters
    ----------
    problem, hint, remedy
        As in `CascadenormError`; with `parameter` the problem is a predicate, "is -1; it must be …".
    parameter
        Name of the parameter or control, which precedes the problem in the message; empty if there is none.
    """

    def __init__(
        self, problem: str = "", *, parameter: str = "", hint: str = "", remedy: tuple[str, object] | None = None
    ) -> None:
        super().__init__(problem, hint=hint, remedy=remedy)
        self.parameter = parameter

    def _stated(self, spelling: Spelling) -> str:
        return f"{spelling(self.parameter, None)} {self.problem}" if self.parameter else self.problem


class ConfigError(CascadenormError, ValueError):
    """A training configuration that cannot be used; the message names the key."""


class OutputError(CascadenormError, OSError):
    """An output that exists already or cannot be written; nothing has been changed.

    Parameters
    ----------
    problem, hint, remedy
        As in `CascadenormError`.
    existing
        Names of the files that are there already.
    """

    def __init__(
        self,
        problem: str = "",
        *,
        hint: str = "",
        remedy: tuple[str, object] | None = None,
        existing: Sequence[str] = (),
    ) -> None:
        super().__init__(problem, hint=hint, remedy=remedy)
        self.existing = list(existing)


class DenoiseError(CascadenormError, RuntimeError):
    """A method that returned no usable vertices."""


class WorkerError(CascadenormError, RuntimeError):
    """A worker process that ended before its work was done."""


class MissingDependencyError(CascadenormError, ImportError):
    """A package that an optional feature needs and that is not installed.

    Parameters
    ----------
    feature
        What needs it, such as "training".
    package
        What is missing, several names with spaces between.
    extra
        The extra of cascadenorm that installs it, empty if none does.

    Attributes
    ----------
    command
        What installs it with pip.
    """

    def __init__(self, feature: str, *, package: str = "", extra: str = "") -> None:
        super().__init__(feature)
        self.package, self.extra = package, extra
        self.command = f'pip install "cascadenorm[{extra}]"' if extra else f"pip install {package}"
        self.problem, self.hint = f"{feature} needs {package}, which is not installed", self.command


def counted(count: int, one: str, several: str = "") -> str:
    """Return a count with its noun; the plural is given, or the singular with an s."""
    return f"{count} {one if count == 1 else several or f'{one}s'}"


def reason(error: Exception) -> str:
    """Return what an error of another library says, with its kind where that alone says little."""
    if isinstance(error, KeyError | IndexError | AssertionError) or not str(error):
        return f"it does not follow the format ({' '.join([type(error).__name__, str(error)]).strip()})"
    return str(error)
