"""Exceptions of the package.

Messages are written for Python callers. A front end with other names for settings, such as the command line, passes its
own naming function to `message`.
"""

from collections.abc import Callable, Sequence
from copy import copy
from typing import TypeVar

Located = TypeVar("Located", bound="CascadenormError")

Remedy = tuple[str, object]  # name and value of a setting that solves a problem

SettingName = Callable[[str, object], str]
"""Function that returns the name of a setting in an interface, given its name in Python and optionally its value."""


def in_python(name: str, value: object = None) -> str:
    """Format a setting as a keyword argument."""
    return name if value is None else f"{name}={value!r}"


class CascadenormError(Exception):
    """Base class of all errors of this package.

    Parameters
    ----------
    problem
        What is wrong, with the value and the location.
    hint
        How to solve the problem.
    remedy
        Name and value of a setting that also solves the problem, such as ("force", True).

    Attributes
    ----------
    place
        Name of the file or stream with the problem, empty if there is none.
    """

    def __init__(self, problem: str = "", *, hint: str = "", remedy: Remedy | None = None) -> None:
        super().__init__(problem)
        self.problem, self.hint, self.remedy, self.place = problem, hint, remedy, ""

    def message(self, setting_name: SettingName = in_python) -> str:
        """Return the location, problem and solutions as one sentence.

        Parameters
        ----------
        setting_name
            Function that returns the name of a setting in an interface, given its name in Python and its value or None.
            By default, settings are named as in Python.

        Returns
        -------
        Text of one line, as shown to a user.
        """
        ways = [self.hint] if self.hint else []
        if self.remedy:
            verb = "denoise with" if self.remedy[0] == "on_bad" else "pass"  # other functions have no `on_bad`
            ways.append(f"{verb} {setting_name(*self.remedy)}")
        place = f"{self.place}: " if self.place else ""
        return f"{place}{self._stated(setting_name)}{': ' if ways else ''}{', or '.join(ways)}"

    def within(self: Located, place: str) -> Located:
        """Return a copy of the error with the name of the file it concerns.

        Parameters
        ----------
        place
            Name of the file or stream, which precedes the problem in the message.

        Returns
        -------
        An error of the same class.
        """
        located = copy(self)
        located.place = place
        return located

    def __str__(self) -> str:
        return self.message()

    def _stated(self, setting_name: SettingName) -> str:
        return self.problem


class MeshError(CascadenormError, ValueError):
    """A mesh cannot be processed."""


class ReadError(MeshError):
    """A file cannot be read as a mesh."""


class ParameterError(CascadenormError, ValueError):
    """A method, parameter or control is unknown, or a value is out of range.

    Parameters
    ----------
    problem, hint, remedy
        As in `CascadenormError`. With `parameter`, the problem is a predicate such as "is -1; it must be …".
    parameter
        Name of the parameter or control that precedes the problem in the message; empty if there is none.
    """

    def __init__(self, problem: str = "", *, parameter: str = "", hint: str = "", remedy: Remedy | None = None) -> None:
        super().__init__(problem, hint=hint, remedy=remedy)
        self.parameter = parameter

    def _stated(self, setting_name: SettingName) -> str:
        return f"{setting_name(self.parameter, None)} {self.problem}" if self.parameter else self.problem


class ConfigError(CascadenormError, ValueError):
    """A training configuration cannot be used; the message names the key."""


class OutputError(CascadenormError, OSError):
    """An output already exists or cannot be written; nothing was changed. `existing` lists the existing files."""

    def __init__(
        self, problem: str = "", *, hint: str = "", remedy: Remedy | None = None, existing: Sequence[str] = ()
    ) -> None:
        super().__init__(problem, hint=hint, remedy=remedy)
        self.existing = list(existing)


class DenoiseError(CascadenormError, RuntimeError):
    """A method did not return usable vertices."""


class WorkerError(CascadenormError, RuntimeError):
    """A worker process ended before its work was done."""


class MissingDependencyError(CascadenormError, ImportError):
    """A package that an optional feature needs is not installed.

    Parameters
    ----------
    feature
        Feature that needs the package, such as "training".
    package
        Name of the missing package, or several names separated by spaces. `command` installs them with pip.
    extra
        Extra of cascadenorm that installs it; empty if none does.
    """

    def __init__(self, feature: str, *, package: str = "", extra: str = "") -> None:
        super().__init__(feature)
        self.package, self.extra = package, extra
        self.command = f'pip install "cascadenorm[{extra}]"' if extra else f"pip install {package}"
        self.problem, self.hint = f"{feature} needs {package}, which is not installed", self.command


def counted(count: int, one: str, several: str = "") -> str:
    """Return a count with its noun in singular or plural; the default plural adds an s."""
    return f"{count} {one if count == 1 else several or f'{one}s'}"


def reason(error: Exception) -> str:
    """Return the message of an error of another library, with its type if the message alone is not informative."""
    if isinstance(error, KeyError | IndexError | AssertionError) or not str(error):
        return f"it does not follow the format ({' '.join([type(error).__name__, str(error)]).strip()})"
    return str(error)
