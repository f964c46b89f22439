"""The declaration of all controls.

The checks, the signatures and docstrings of `denoise` and `denoise_file`, the command line options and the tables in
docs/controls.md are generated from it. A new control needs a new key of `Controls` and the step that applies it.
"""

import inspect
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from os import PathLike
from textwrap import fill
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict, TypeVar, cast, get_type_hints

from cascadenorm.errors import ParameterError
from cascadenorm.registry.parameters import Parameter, Setting, declared

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

else:

    class ArrayLike:
        """Stand-in for the numpy type, so that the command line can import this module without numpy."""


Boundary = Literal["free", "smooth", "fixed"]
OnBad = Literal["error", "isolate"]
Length = float | str  # a length in mesh units, or in mean edge lengths as text like "0.5 edges"
Path = str | PathLike[str]

Function = TypeVar("Function", bound=Callable[..., Any])


@dataclass(frozen=True, kw_only=True)
class Control(Parameter):
    """The annotation of a control: a `Parameter` with a default value and details for user interfaces."""

    default: Any = None  # value that has no effect
    arrays: str = ""  # values it accepts in Python, if these are not just numbers or choices
    words: str = ""  # values it accepts for a mesh file, in Python and on the command line
    example: Any = None  # value for the documentation
    metavar: str = ""  # placeholder for the value in the command line help; empty for numbers and choices
    flag: str = ""  # option without a value that selects the only choice, such as --keep-volume for volume="keep"
    hidden: bool = False  # whether the control has no command line option


class Controls(TypedDict, total=False):
    """Keyword arguments of `denoise` that apply to every method."""

    strength: Annotated[
        float,
        Control(
            help="Strength of the denoising: 0 keeps the mesh, 1 applies the method, and values in between interpolate "
            "linearly. Above 1, the method is applied again to its own result; `auto` instead removes features up to "
            "2 (strength − 1) mean edge lengths wide.",
            minimum=0,
            below=math.inf,
            default=1.0,
            example=0.5,
            metavar="NUMBER",
        ),
    ]
    mask: Annotated[
        ArrayLike | Path | None,
        Control(
            help="Weight of the displacement of each vertex, from 0 (fixed) to 1 (free).",
            arrays="(n,) bool or numbers",
            words="the name of a vertex attribute of the file (bytes: 0 to 255, or 0 and 1), or a .npy or .txt file",
            example="quality",
            metavar="NAME|FILE",
        ),
    ]
    fixed: Annotated[
        ArrayLike | Path | None,
        Control(
            help="Vertices that do not move.",
            arrays="(n,) bool or vertex indices",
            words='indices such as "0,5,7-20", the name of a vertex attribute that is nonzero at these vertices, or a '
            ".npy or .txt file of indices",
            example="0,5,7-20",
            metavar="LIST|NAME|FILE",
        ),
    ]
    only: Annotated[
        ArrayLike | str | list[str] | None,
        Control(
            help="Faces to denoise. A vertex moves only if all of its faces are selected.",
            arrays="(m,) bool or face indices",
            words="the name of a material, group, object or mesh, or KIND=NAME, such as material=steel or, for a face "
            "property, segment=3; several names select their union",
            example="material=steel",
            metavar="[KIND=]NAME",
        ),
    ]
    boundary: Annotated[
        Boundary,
        Control(
            help="Treatment of boundary vertices: free moves them as the method does, smooth smooths each boundary "
            "loop as a curve along the surface, and fixed leaves them unchanged.",
            default="free",
            example="smooth",
        ),
    ]
    slide: Annotated[
        Literal["planes"] | None,
        Control(
            help="With planes, vertices on flat outer sides of the mesh, such as the box around a volume mesh, move "
            "only within their plane. Where two such sides meet, vertices move only along the edge, and corners are "
            "fixed.",
            example="planes",
        ),
    ]
    creases: Annotated[
        float | ArrayLike | Path | None,
        Control(
            help="Edges across which nothing is averaged: either all edges where the normals of the two faces differ "
            "by more than an angle in degrees, or a list of edges.",
            arrays="the angle, or (k, 2) vertex indices of edges",
            words="the angle, or a .npy or .txt file with two vertex indices in each row",
            example=40,
            metavar="ANGLE|FILE",
        ),
    ]
    keep_detail: Annotated[
        Length | None,
        Control(
            help='Width of the smallest feature to keep, in mesh units or in mean edge lengths, as in "4 edges".',
            example="4 edges",
            metavar="LENGTH",
        ),
    ]
    remove_detail: Annotated[
        Length | None,
        Control(
            help="Width of the errors to remove, such as steps or bumps, in mesh units or in mean edge lengths, as in "
            '"4 edges". The method runs on coarse copies of the mesh. Wider features and their edges are kept.',
            example="4 edges",
            metavar="LENGTH",
        ),
    ]
    volume: Annotated[
        Literal["keep"] | None,
        Control(
            help="Scale each closed component about its centroid to its original volume. If regions share walls, the "
            "walls are offset until each region has its original volume.",
            example="keep",
            flag="--keep-volume",
        ),
    ]
    max_displacement: Annotated[
        Length | None,
        Control(
            help="Largest distance that a vertex may move, in mesh units or in mean edge lengths, as in "
            '"0.5 edges". By default, the distance is not limited.',
            example="0.5 edges",
            metavar="LENGTH",
        ),
    ]
    on_bad: Annotated[
        OnBad,
        Control(
            help="Treatment of vertices that are not finite, and of faces that reference them or missing vertices: "
            "error rejects the mesh; isolate leaves them and degenerate faces unchanged and denoises the rest.",
            default="error",
            example="isolate",
        ),
    ]
    threads: Annotated[
        int | None,
        Control(
            help="Maximum number of threads. By default, all cores are used. The result does not depend on it.",
            minimum=1,
            example=2,
            metavar="N",
        ),
    ]
    progress: Annotated[
        Callable[[float], object] | None,
        Control(
            help="Function that is called with the completed fraction, from 0 to 1. An exception that it raises stops "
            "the work.",
            metavar="function",
            hidden=True,
        ),
    ]
    halo: Annotated[
        object | None,
        Control(
            help="Halo of a mesh that is a patch of a larger one. Vertices of the halo are fixed, and all others move "
            "exactly as in the whole mesh; see docs/patches.md.",
            metavar="patch.halo",
            hidden=True,
        ),
    ]


@dataclass(frozen=True)
class ControlSetting(Setting):
    """A control with its name, type and default."""

    about: Control

    @property
    def option(self) -> str:
        """Name of the command line option, such as --keep-detail."""
        return self.about.flag or f"--{self.name.replace('_', '-')}"

    def help(self, takes: str) -> str:
        """Return sentences that describe the control and the values it accepts."""
        return f"{self.about.help} {takes[0].upper()}{takes[1:]}." if takes else self.about.help


def _declared() -> dict[str, ControlSetting]:
    hints = get_type_hints(Controls, include_extras=True)
    found = {name: declared(name, hint) for name, hint in hints.items()}
    return {name: ControlSetting(name, kind, about.default, about) for name, (kind, about) in found.items()}


CONTROLS = _declared()  # all controls by name, in the order of the documentation


def checked_controls(given: Mapping[str, Any]) -> Controls:
    """Return all controls, with defaults for those not given.

    Values that depend on the mesh, such as masks, indices and edges, are checked where they are applied. Raises
    ParameterError if a control does not exist, or a value has the wrong type or is out of range.
    """
    if unknown := [name for name in given if name not in CONTROLS]:
        meant = get_close_matches(unknown[0], CONTROLS, n=1)
        raise ParameterError(
            f"there is no control {unknown[0]!r}; there are: {', '.join(CONTROLS)}",
            hint=f"did you mean {meant[0]!r}?" if meant else "parameters of the method go into `parameters`",
        )
    controls = {name: setting.checked(given.get(name, setting.default)) for name, setting in CONTROLS.items()}
    for name, setting in CONTROLS.items():
        if setting.kinds == (float, str) and controls[name] is not None:
            parsed_length(name, controls[name])
        elif isinstance(controls[name], set | frozenset):
            raise ParameterError("is a set; it must be a list or an array", parameter=name)
        elif isinstance(controls[name], list | tuple):
            from cascadenorm.mesh import as_array  # the command line imports this module without numpy

            as_array(controls[name], ParameterError("is a list whose rows have different lengths", parameter=name))
    if controls["progress"] is not None and not callable(controls["progress"]):
        raise ParameterError(f"is {controls['progress']!r}; it must be a function", parameter="progress")
    return cast(Controls, controls)


def parsed_length(name: str, length: Length | None) -> tuple[float, bool]:
    """Parse a length and whether its unit is the mean edge length; None is infinite, others raise ParameterError."""
    if length is None:
        return math.inf, False
    match = re.fullmatch(r"\s*([^\s]+?)\s*(edges?)?\s*", str(length))
    try:
        number = float(match[1]) if match else math.nan
    except ValueError:
        number = math.nan
    if math.isnan(number) or number < 0:
        raise ParameterError(f'is {length!r}; it must be a length, at least 0, or like "0.5 edges"', parameter=name)
    return number, bool(match and match[2])


def with_control_parameters(function: Function) -> Function:
    """Replace `**controls` in the signature and docstring of a function by the individual controls.

    `**parameters` stays last in the signature. The docstring needs a section Returns, before which the controls are
    listed.
    """
    own = list(inspect.signature(function).parameters.values())
    last = [p for p in own if p.kind is inspect.Parameter.VAR_KEYWORD and p.name == "parameters"]
    controls = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=setting.default, annotation=setting.kind)
        for name, setting in CONTROLS.items()
    ]
    first = [p for p in own if p.kind is not inspect.Parameter.VAR_KEYWORD]
    before, returns, after = (inspect.getdoc(function) or "").partition("\nReturns\n")
    listed = "\n".join(
        f"{name}\n" + fill(setting.help(setting.about.arrays), 115, initial_indent="    ", subsequent_indent="    ")
        for name, setting in CONTROLS.items()
    )
    function.__doc__ = f"{before}\nControls\n--------\n{listed}\n{returns}{after}"
    function.__signature__ = inspect.Signature([*first, *controls, *last])  # type: ignore[attr-defined]
    return function
