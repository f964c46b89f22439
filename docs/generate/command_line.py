"""Write docs/command-line.md from the declarations of the commands: python docs/generate/command_line.py"""

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from markdown_table import table
from typer.models import ArgumentInfo

from cascadenorm.cli.commands import app

PAGE = Path(__file__).parents[1] / "command-line.md"
INTRODUCTION = """\
# Command line

<!-- python docs/generate/command_line.py writes this page -->

This page lists every command with its arguments and options, as `--help` prints them. Results go to stdout
and messages to stderr. With `--json`, a command prints one object; [JSON output](json.md) describes its keys and the
exit codes.
"""


def main() -> None:
    """Write the page."""
    PAGE.write_text(command_page(), encoding="utf-8", newline="\n")


def command_page() -> str:
    """Return the page of all commands, as Markdown."""
    parts = [part for command in app.registered_commands for part in _command(command)]
    return "\n".join([INTRODUCTION, *parts, "## Controls\n", table(("control", "meaning", "default"), _controls())])


def _controls() -> list[tuple[str, str, str]]:
    """Return a row for each control, in the order of their declaration."""
    rows: dict[str, tuple[str, str, str]] = {}
    for command in app.registered_commands:
        for parameter in inspect.signature(command.callback).parameters.values():
            kind, about = get_args(parameter.annotation)
            if not isinstance(about, ArgumentInfo) and about.rich_help_panel == "Controls":
                rows.setdefault(parameter.name, _row(parameter, kind, about))
    return list(rows.values())


def _row(parameter: inspect.Parameter, kind: Any, about: Any) -> tuple[str, str, str]:
    """Return an option as it is written, its meaning and its default."""
    shown = "" if parameter.default in (None, False, inspect.Parameter.empty) else f"`{parameter.default}`"
    return _option_text(parameter.name, kind, about), about.help, shown


def _command(command: Any) -> Iterator[str]:
    function = command.callback
    name = command.name or function.__name__
    yield f"## `{name}`\n\n{(inspect.getdoc(function) or '').replace('<', '&lt;')}\n"
    tables: dict[str, list[tuple[str, str, str]]] = {}
    words = ["cascadenorm", name]
    for parameter in inspect.signature(function).parameters.values():
        kind, about = get_args(parameter.annotation)
        row = _row(parameter, kind, about)
        if isinstance(about, ArgumentInfo):
            metavar = about.metavar or f"[{parameter.name.upper()}]"
            words.append(metavar)
            tables.setdefault("argument", []).append((f"`{metavar}`", *row[1:]))
        else:
            tables.setdefault("control" if about.rich_help_panel == "Controls" else "option", []).append(row)
    yield f"```text\n{' '.join(words)}{' [OPTIONS]' if {'option', 'control'} & set(tables) else ''}\n```\n"
    controls = tables.pop("control", [])
    for title, rows in tables.items():
        yield table((title, "meaning", "default"), rows)
    if controls:
        known = ", ".join(option.split(" ")[0].strip("`") for option, *_ in controls)
        yield f"It also has the [controls](#controls) {known}.\n"


def _option_text(name: str, kind: Any, about: Any) -> str:
    """Return an option as it is written, with the value that it needs."""
    declared = [about.default, *(about.param_decls or ())]  # typer takes the first name for a default
    named = [text for text in declared if isinstance(text, str) and text.startswith("-")]
    named = named or [f"--{name.replace('_', '-')}"]
    if bool in (kind, *get_args(kind)):
        both = f" / --no-{named[0][2:]}" if type(None) in get_args(kind) else ""
        return f"`{', '.join(named)}{both}`"
    return f"`{', '.join(named)} {about.metavar or _value(kind)}`"


def _value(kind: Any) -> str:
    kinds = {int: "NUMBER", float: "NUMBER", Path: "FILE"}
    return next((word for one, word in kinds.items() if one in (kind, *get_args(kind))), "TEXT")


def names() -> list[str]:
    """Return the names of all commands."""
    return [command.name or command.callback.__name__ for command in app.registered_commands]


if __name__ == "__main__":
    main()
