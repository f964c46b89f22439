"""Parse plain calls of commands from their declarations, without the parser of typer, which is slow to load.

Its newer versions import a library for validation, which takes about as long as denoising 10,000 faces. Calls that are
not plain, such as those that ask for help, abbreviate an option or have a mistake, are left to typer.
"""

import inspect
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, get_args

from typer.models import ArgumentInfo, OptionInfo

from cascadenorm.cli.commands import app

CONVERTED = (str, Path, int, float)  # types of values that are called with the text


class _Declared(NamedTuple):
    """A parameter of a command: its name, its type without None, its option or argument, and its default."""

    name: str
    kind: Any
    about: OptionInfo | ArgumentInfo
    default: Any

    @property
    def plain(self) -> bool:
        """Whether a value needs a conversion only."""
        limits = self.about.min, self.about.max, self.about.callback
        return self.kind in (*CONVERTED, bool, list[str]) and limits == (None, None, None)

    @property
    def options(self) -> list[str]:
        """The names of an option on the command line; none for those with a name for each of two values."""
        given = [self.about.default, *(self.about.param_decls or ())]  # typer stores the first name as the default
        names = [name for name in given if isinstance(name, str)]
        if not names and self.kind is not bool:
            names = [f"--{self.name.replace('_', '-')}"]
        return [name for name in names if "/" not in name]


def plain_call(arguments: Sequence[str]) -> "partial[object] | None":
    """Return the call that typer would make for command line arguments, or None if they are not plain."""
    for registered in app.registered_commands:
        command = registered.callback
        if command is not None and arguments and arguments[0] == (registered.name or command.__name__):
            values = _values([_declared(one) for one in inspect.signature(command).parameters.values()], arguments[1:])
            return None if values is None else partial(command, **values)
    return None


def _declared(parameter: inspect.Parameter) -> _Declared:
    kind, about = get_args(parameter.annotation)
    kinds = [one for one in get_args(kind) if one is not type(None)]
    return _Declared(
        parameter.name, kinds[0] if len(kinds) == 1 and kind != list[str] else kind, about, parameter.default
    )


def _values(declared: Sequence[_Declared], arguments: Sequence[str]) -> dict[str, Any] | None:
    """Return the value of each parameter, or None if the arguments are not plain."""
    places = [one for one in declared if isinstance(one.about, ArgumentInfo)]
    options = {name: one for one in declared if isinstance(one.about, OptionInfo) and one.plain for name in one.options}
    given: dict[str, Any] = {}
    words = iter(arguments)
    for word in words:
        name, equals, text = word.partition("=") if word.startswith("--") else (word, "", "")
        if word == "-" or not word.startswith("-"):
            if not places or not places[0].plain or places[0].kind not in CONVERTED:
                return None
            one, text = places.pop(0), word
        elif name not in options:
            return None
        else:
            one = options[name]
            if one.kind is bool:
                if equals:
                    return None
                given[one.name] = True
                continue
            if not equals:
                following = next(words, None)
                if following is None:
                    return None
                text = following
        if one.kind == list[str]:
            given.setdefault(one.name, []).append(text)
            continue
        try:
            given[one.name] = one.kind(text)
        except ValueError:
            return None
    values = {one.name: given.get(one.name, one.default) for one in declared}
    return None if inspect.Parameter.empty in values.values() else values
