"""Registry of all denoising methods.

The command line, the evaluation, the documentation and the tests read it. A method is a function from a mesh and
keyword parameters to the new vertices. The annotation of each parameter declares its meaning and the values it accepts,
from which checks, messages and tables are generated:

    @method("laplacian", source="Desbrun et al. 1999")
    def laplacian(mesh: Mesh, *, steps: Annotated[int, Parameter("Number of steps", minimum=0)] = 10) -> Vectors:
"""

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, get_type_hints

from cascadenorm.errors import ParameterError
from cascadenorm.registry.controls import CONTROLS
from cascadenorm.registry.parameters import Setting, checked_names, declared

if TYPE_CHECKING:  # lets the command line read declarations without loading numpy
    from cascadenorm.mesh import Mesh, Vectors

RESERVED = {"mesh", "faces", "method", *CONTROLS}
"""Names that a parameter of a method cannot have, since they are parameters of `denoise`."""
REGION = "region"
"""Name of the parameter that receives the vertices that may move, (n,) bool, derived from the controls."""

Rings = Callable[[Mapping[str, Any], int], int | None]


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
        for name in checked_names("parameters", parameters):
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
        Name of the method for users, in lower case with hyphens. Modules cannot replace the methods of others.
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
        if name in _methods and (other := _methods[name].function.__module__) != function.__module__:
            raise ParameterError(f"{other} registers a method {name!r} already", hint="choose another name")
        _methods[name] = Method(name, function, source, _settings(function), converges, rings, family)
        return function

    return register


def find(name: str) -> Method:
    """Return a method by its name; raises ParameterError if there is none."""
    if not isinstance(name, str) or name not in _methods:
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


def _settings(function: "Callable[..., Vectors]") -> dict[str, Setting]:
    hints = get_type_hints(function, include_extras=True)
    settings = {}
    for name, parameter in list(inspect.signature(function).parameters.items())[1:]:  # the first is the mesh
        if parameter.kind is not inspect.Parameter.KEYWORD_ONLY:
            raise TypeError(f"{function.__qualname__}: {name} must be a keyword-only parameter, after *")
        if name in RESERVED:
            raise ParameterError(f"{function.__qualname__}: {name} is a setting of denoise: rename the parameter")
        if parameter.default is parameter.empty:
            raise TypeError(f"{function.__qualname__}: {name} needs a default value")
        kind, about = declared(f"{function.__qualname__}: {name}", hints.get(name))
        settings[name] = Setting(name, kind, parameter.default, about)
    return settings
