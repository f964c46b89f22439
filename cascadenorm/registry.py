"""Every denoising method, registered once: what the command line, the evaluation, the docs and the tests go by.

A method is a function from a mesh and keyword parameters to the new vertices. Its parameters say what they are in
their annotation, so that ranges are checked and texts are written in one place:

    @method("laplacian", source="Desbrun et al. 1999")
    def laplacian(mesh: Mesh, *, steps: Annotated[int, Parameter("steps taken", minimum=0)] = 10) -> Vectors:
"""

import inspect
import math
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from cascadenorm.mesh import Mesh, Vectors

REGION = "region"
"""A method with a parameter of this name is told which vertices may move, (n,) bool; callers say it by a mask."""


class ParameterError(ValueError):
    """A method that does not exist, a parameter that it does not have, or a value out of range."""


@dataclass(frozen=True)
class Parameter:
    """What an annotation says of a parameter: its meaning, its unit, the values it may take."""

    help: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    below: float | None = None

    @property
    def allowed(self) -> str:
        """The range in words: 'at least 0, below 1'; empty if there is none."""
        limits = {"at least": self.minimum, "at most": self.maximum, "above": self.above, "below": self.below}
        return ", ".join(f"{word} {limit:g}" for word, limit in limits.items() if limit is not None)

    def admits(self, value: float) -> bool:
        """Tell whether a number is in range; NaN never is."""
        return not (
            math.isnan(value)
            or (self.minimum is not None and value < self.minimum)
            or (self.maximum is not None and value > self.maximum)
            or (self.above is not None and value <= self.above)
            or (self.below is not None and value >= self.below)
        )


@dataclass(frozen=True)
class Setting:
    """One keyword parameter of a method: its name, type and default beside its `Parameter`."""

    name: str
    kind: Any
    default: Any
    about: Parameter

    @property
    def choices(self) -> tuple[Any, ...]:
        """The values of a `Literal`, else empty."""
        return get_args(self.kind) if get_origin(self.kind) is Literal else ()

    def checked(self, value: Any) -> Any:
        """Return the value as this setting's type; text, as it comes from a command line, is read."""
        if self.choices:
            for choice in self.choices:
                if value == choice or (isinstance(value, str) and value == str(choice)):
                    return choice
            raise ParameterError(f"{self.name} is {value!r}; it must be one of {', '.join(map(str, self.choices))}")
        optional = get_origin(self.kind) in (Union, types.UnionType)
        if optional and (value is None or (isinstance(value, str) and value == "none")):
            return None
        kind = next(k for k in get_args(self.kind) if k is not type(None)) if optional else self.kind
        return self._number(kind, value) if kind in (int, float) else value

    def _number(self, kind: type, value: Any) -> Any:
        try:
            number = float(value)
            if kind is int and number != int(number):
                raise ValueError
        except (TypeError, ValueError, OverflowError):
            word = "a whole number" if kind is int else "a number"
            raise ParameterError(f"{self.name} is {value!r}; it must be {word}") from None
        if not self.about.admits(number):
            raise ParameterError(f"{self.name} is {value}; it must be {self.about.allowed or 'a number'}")
        return kind(number)


@dataclass(frozen=True)
class Method:
    """A registered method: its name, where it comes from, what it takes."""

    name: str
    function: Callable[..., Vectors]
    source: str
    settings: Mapping[str, Setting]

    @property
    def summary(self) -> str:
        """First line of the function's docstring."""
        return (inspect.getdoc(self.function) or "").split("\n", 1)[0]

    @property
    def given_by_name(self) -> list[Setting]:
        """Settings that users name: all but the region."""
        return [setting for setting in self.settings.values() if setting.name != REGION]

    def checked(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return the parameters in their types.

        Raises
        ------
        ParameterError : an unknown name, a value of the wrong type or out of range
        """
        for name in parameters:
            if name not in self.settings:
                known = ", ".join(setting.name for setting in self.given_by_name) or "none"
                raise ParameterError(f"{self.name} has no parameter {name!r}; it has: {known}")
        return {name: self.settings[name].checked(value) for name, value in parameters.items()}

    def __call__(self, mesh: Mesh, **parameters: Any) -> Vectors:
        """Return the new vertices of a mesh."""
        return self.function(mesh, **self.checked(parameters))


_methods: dict[str, Method] = {}


def method(name: str, *, source: str) -> Callable[[Callable[..., Vectors]], Callable[..., Vectors]]:
    """Register a function from a mesh to its new vertices under a name.

    Parameters
    ----------
    name : as users type it, lower case with hyphens
    source : authors and year of the paper that the rule comes from
    """

    def register(function: Callable[..., Vectors]) -> Callable[..., Vectors]:
        _methods[name] = Method(name, function, source, _settings(function))
        return function

    return register


def find(name: str) -> Method:
    """Return the method of that name.

    Raises
    ------
    ParameterError : there is none
    """
    if name not in _methods:
        raise ParameterError(f"there is no method {name!r}; there are: {', '.join(sorted(_methods))}")
    return _methods[name]


def registered() -> dict[str, Method]:
    """Every method, by name."""
    return dict(sorted(_methods.items()))


def _settings(function: Callable[..., Vectors]) -> dict[str, Setting]:
    hints = get_type_hints(function, include_extras=True)
    settings = {}
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is not inspect.Parameter.KEYWORD_ONLY:
            continue
        hint = hints[name]
        if get_origin(hint) is not Annotated or not isinstance(get_args(hint)[1], Parameter):
            raise TypeError(f"{function.__qualname__}: {name} needs an Annotated[type, Parameter(...)]")
        kind, about = get_args(hint)[:2]
        settings[name] = Setting(name, kind, parameter.default, about)
    return settings
