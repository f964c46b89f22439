"""Registry of all denoising methods.

The command line, the evaluation, the documentation and the tests read it. A method is a function from a mesh and
keyword parameters to the new vertices. The annotation of each parameter declares its meaning and the values it accepts,
from which checks, messages and tables are generated:

    @method("laplacian", source="Desbrun et al. 1999")
    def laplacian(mesh: Mesh, *, steps: Annotated[int, Parameter("Number of steps", minimum=0)] = 10) -> Vectors:
"""

import inspect
import math
import re
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from operator import ge, gt, le, lt
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from cascadenorm.errors import ParameterError as ParameterError

if TYPE_CHECKING:  # lets the command line read declarations without loading numpy
    from cascadenorm.mesh import Mesh, Vectors

REGION = "region"
"""Name of the parameter that receives the vertices that may move, (n,) bool, derived from the controls."""

Rings = Callable[[Mapping[str, Any], int], int | None]


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
        """Values of a `Literal`; empty for other types."""
        (kind, *others) = self.kinds
        return get_args(kind) if not others and get_origin(kind) is Literal else ()

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
            if value == choice or (isinstance(value, str) and value == str(choice)):
                return choice
        known = ", ".join(map(str, self.choices)) + (", none" if self.optional else "")
        raise ParameterError(f"is {value!r}; it must be one of {known}", parameter=self.name)

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


@dataclass(frozen=True)
class Family:
    """A group of similar methods, with a title and a description in plain words."""

    title: str
    about: str


FAMILIES: Mapping[str, Family] = {
    "learned": Family(
        "Learned",
        "Networks that were trained on shapes with known noise. The most accurate on most meshes, not the fastest.",
    ),
    "normals": Family(
        "Filters of face normals",
        "Even out the directions of neighbouring faces, then move the vertices to fit. Sharp edges can stay sharp.",
    ),
    "sparsity": Family(
        "Sparsity", "Look for few, sharp bends between flat faces. For machine parts and other shapes with flat sides."
    ),
    "bilateral": Family(
        "Bilateral filters of the vertices",
        "Move each vertex toward its neighbours, those across an edge counting less. Fast, for little noise.",
    ),
    "smoothing": Family(
        "Diffusion, flows and spectra",
        "Smooth the whole surface alike. Simple and fast; sharp edges become round, and some methods shrink the mesh.",
    ),
    "own": Family("Added methods", "Registered by your own code."),
}
"""Families of methods by name, in the order shown to users."""


@dataclass(frozen=True)
class Method:
    """A registered method with its source and parameters.

    `converges` is True if applying the method to its own result changes it little. `rings` returns the size of
    the receptive field in edges; None if the method depends on the whole mesh. `family` is a key of FAMILIES.
    """

    name: str
    function: "Callable[..., Vectors]"
    source: str
    settings: Mapping[str, Setting]
    converges: bool = False
    rings: "Rings | None" = None
    family: str = "own"

    @property
    def summary(self) -> str:
        """First line of the function's docstring."""
        return (inspect.getdoc(self.function) or "").split("\n", 1)[0]

    def section(self, title: str) -> str:
        """Return a section of the function's docstring, such as "Formula", or an empty text if there is none.

        The title "" selects the text before the first section.
        """
        text = inspect.getdoc(self.function) or ""
        before, *parts = re.split(r"^(\S.*)\n-+\n", text, flags=re.MULTILINE)
        sections = {"": before, **dict(zip(parts[::2], parts[1::2], strict=True))}
        return sections.get(title, "").strip()

    @property
    def given_by_name(self) -> list[Setting]:
        """Settings that users can set: all except the region."""
        return [setting for setting in self.settings.values() if setting.name != REGION]

    def checked(self, parameters: Mapping[str, Any], *, further: Sequence[str] = ()) -> dict[str, Any]:
        """Check parameters and convert them to their types; raises ParameterError for unknown names and bad values.

        Messages suggest names of the method, and `further` ones that the caller accepts, for misspelled names.
        """
        for name in parameters:
            if name not in self.settings:
                own = [setting.name for setting in self.given_by_name]
                meant = get_close_matches(name, [*own, *further], n=1)
                raise ParameterError(
                    f"{self.name} has no parameter {name!r}; it has: {', '.join(own) or 'none'}",
                    hint=f"did you mean {meant[0]!r}?" if meant else "",
                )
        return {name: self.settings[name].checked(value) for name, value in parameters.items()}

    def with_defaults(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return all parameters, with defaults for those not given; raises ParameterError as `checked` does."""
        return {name: setting.default for name, setting in self.settings.items()} | self.checked(parameters)

    def receptive_field(self, parameters: Mapping[str, Any], groups: int) -> int | None:
        """Return the number of edges around a vertex within which the mesh determines its position; None if unlimited.

        It depends on the number of groups in which the vertex update processes the vertices.
        """
        return None if self.rings is None else self.rings(self.with_defaults(parameters), groups)

    def __call__(self, mesh: "Mesh", **parameters: Any) -> "Vectors":
        """Return the new vertices of a mesh."""
        return self.function(mesh, **self.checked(parameters))


_methods: dict[str, Method] = {}


def method(
    name: str, *, source: str, family: str = "own", converges: bool = False, rings: Rings | None = None
) -> "Callable[[Callable[..., Vectors]], Callable[..., Vectors]]":
    """Register a function that returns the new vertices of a mesh.

    Parameters
    ----------
    name
        Name of the method for users, in lower case with hyphens.
    source
        Authors and year of the paper that describes the method.
    family
        Key of FAMILIES that the method is listed under.
    converges
        Whether applying the method to its own result changes it little. A strength above 1 then removes detail instead.
    rings
        Function from all parameters and the number of groups of the vertex update to the receptive field in edges.
        None, or a result of None, means that the method depends on the whole mesh.
    """

    def register(function: "Callable[..., Vectors]") -> "Callable[..., Vectors]":
        if family not in FAMILIES:
            raise ParameterError(f"there is no family {family!r}; there are: {', '.join(FAMILIES)}")
        _methods[name] = Method(name, function, source, _settings(function), converges, rings, family)
        return function

    return register


def find(name: str) -> Method:
    """Return a method by its name; raises ParameterError if there is none."""
    if name not in _methods:
        near = get_close_matches(str(name).lower(), _methods, n=1)
        known = f"did you mean {near[0]!r}? There" if near else "there"
        raise ParameterError(f"there is no method {name!r}; {known} are: {', '.join(sorted(_methods))}")
    return _methods[name]


def registered() -> dict[str, Method]:
    """Return all methods by name."""
    return dict(sorted(_methods.items()))


def by_family() -> dict[Family, list[Method]]:
    """Return all methods by family, with families in the order of FAMILIES and methods sorted by name."""
    found = {key: [one for one in registered().values() if one.family == key] for key in FAMILIES}
    return {FAMILIES[key]: members for key, members in found.items() if members}


def declared(name: str, hint: Any) -> tuple[Any, Any]:
    """Return the type and the `Parameter` of `Annotated[type, Parameter(...)]`; raises TypeError for other types."""
    if get_origin(hint) is not Annotated or not isinstance(get_args(hint)[1], Parameter):
        raise TypeError(f"{name} needs an Annotated[type, Parameter(...)]")
    return get_args(hint)[0], get_args(hint)[1]


def _settings(function: "Callable[..., Vectors]") -> dict[str, Setting]:
    hints = get_type_hints(function, include_extras=True)
    settings = {}
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is not inspect.Parameter.KEYWORD_ONLY:
            continue
        kind, about = declared(f"{function.__qualname__}: {name}", hints[name])
        settings[name] = Setting(name, kind, parameter.default, about)
    return settings
