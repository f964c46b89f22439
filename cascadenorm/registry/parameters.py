"""Declared parameters: the meaning of a setting and the values it accepts, from which it is checked.

The annotation of a parameter declares it: `steps: Annotated[int, Parameter("Number of steps", minimum=0)] = 10`.
"""

import math
import types
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import ge, gt, le, lt
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from cascadenorm.errors import ParameterError


@dataclass(frozen=True)
class Parameter:
    """The annotation of a parameter: its meaning, its unit and the values it accepts."""

    help: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    below: float | None = None

    @property
    def _limits(self) -> list[tuple[str, Callable[[float, float], bool], float]]:
        """The limits that are given: their words, tests and values."""
        limits = (
            ("at least", ge, self.minimum), ("at most", le, self.maximum), ("above", gt, self.above),
            ("below", lt, self.below),
        )  # fmt: skip
        return [(word, test, limit) for word, test, limit in limits if limit is not None]

    @property
    def allowed(self) -> str:
        """Range in words, such as 'at least 0, below 1'; empty if unlimited."""
        return ", ".join("finite" if limit == math.inf else f"{word} {limit:g}" for word, _, limit in self._limits)

    def admits(self, value: float) -> bool:
        """Test whether a number is in range; NaN never is."""
        return not math.isnan(value) and all(test(value, limit) for _, test, limit in self._limits)


@dataclass(frozen=True)
class Setting:
    """A keyword parameter of a method, or a control, with its name, type, default and `Parameter`."""

    name: str
    kind: Any
    default: Any
    about: Parameter

    @property
    def kinds(self) -> tuple[Any, ...]:
        """Types of a union except None, or the single type."""
        united = get_origin(self.kind) in (Union, types.UnionType)
        return tuple(kind for kind in get_args(self.kind) if kind is not types.NoneType) if united else (self.kind,)

    @property
    def optional(self) -> bool:
        """Whether None is allowed."""
        return types.NoneType in get_args(self.kind)

    @property
    def choices(self) -> tuple[Any, ...]:
        """Values of a `Literal` or of bool; empty for other types."""
        (kind, *others) = self.kinds
        if kind is bool and not others:
            return True, False
        return get_args(kind) if not others and get_origin(kind) is Literal else ()

    @property
    def choice_names(self) -> list[str]:
        """Names of the choices, with none if that is allowed; empty for other types."""
        return [*map(str, self.choices), *(["none"] if self.choices and self.optional else [])]

    def checked(self, value: Any) -> Any:
        """Convert a value, which may be text from a command line; raise ParameterError for one that is not allowed."""
        if self.optional and value is None:
            return None
        if self.optional and isinstance(value, str) and value == "none" and str not in self.kinds:
            return None
        if self.choices:
            return self._choice(value)
        return self._number(self.kinds[0], value) if self.kinds in ((int,), (float,)) else value

    def _choice(self, value: Any) -> Any:
        for choice in self.choices:
            if getattr(value, "ndim", 0) == 0 and value in (choice, str(choice)):
                return choice
        raise ParameterError(f"is {value!r}; it must be one of {', '.join(self.choice_names)}", parameter=self.name)

    def _number(self, kind: type, value: Any) -> Any:
        try:
            number = float(value)
            if kind is int and number != int(number):
                raise ValueError
        except (TypeError, ValueError, OverflowError):
            word = "a whole number" if kind is int else "a number"
            raise ParameterError(f"is {value!r}; it must be {word}", parameter=self.name) from None
        if not self.about.admits(number):
            raise ParameterError(f"is {value}; it must be {self.about.allowed or 'a number'}", parameter=self.name)
        return kind(number)


def checked_number(
    name: str,
    kind: Any,
    value: Any,
    *,
    minimum: float | None = None,
    above: float | None = None,
    below: float | None = None,
) -> Any:
    """Check and convert an argument that is no parameter of a method as if it were one.

    The kind is int, float, or one of them with None. Raises ParameterError.
    """
    return Setting(name, kind, None, Parameter("", minimum=minimum, above=above, below=below)).checked(value)


def checked_names(name: str, given: Any) -> Mapping[str, Any]:
    """Return an argument that is a mapping from names to values, None being an empty one. Raises ParameterError."""
    if given is None:
        return {}
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise ParameterError(f"is {given!r}; it must be a dictionary of names and values", parameter=name)
    return given


def declared(name: str, hint: Any) -> tuple[Any, Any]:
    """Return the type and the `Parameter` of `Annotated[type, Parameter(...)]`; raises TypeError for other types."""
    if get_origin(hint) is not Annotated or not isinstance(get_args(hint)[1], Parameter):
        raise TypeError(f"{name} needs an Annotated[type, Parameter(...)]")
    return get_args(hint)[0], get_args(hint)[1]
