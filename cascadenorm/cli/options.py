"""The root of the command line and options of its commands; those of controls are generated from declarations."""

import inspect
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

from cascadenorm.registry.controls import CONTROLS, ControlSetting

app = typer.Typer(name="cascadenorm", no_args_is_help=True, pretty_exceptions_enable=False)


@app.callback(invoke_without_command=True)
def options(version: Annotated[bool, Option("--version", help="Print the version and exit.")] = False) -> None:
    """Denoise triangle meshes by cascaded normal regression, or by one of the classical methods."""
    if version:
        from cascadenorm.version import __version__

        print(f"cascadenorm {__version__}")
        raise typer.Exit


MethodOption = Annotated[str, Option(metavar="NAME", help="Denoising method; `cascadenorm methods` lists all.")]
ModelOption = Annotated[
    Path | None,
    Option(metavar="FILE", help="Weights file for auto or cascade. By default, the shipped weights are used."),
]
Set = Annotated[
    list[str] | None,
    Option("--set", metavar="NAME=VALUE", help="Set a parameter of the method. Repeat the option to set several."),
]
Force = Annotated[bool, Option("--force", help="Overwrite an existing file.")]
ReportFile = Annotated[Path | None, Option("--report", metavar="FILE", help="Also write a report to this HTML file.")]
Scheduler = Annotated[
    str | None,
    Option(metavar="ADDRESS", help="Use the workers of this Dask scheduler; 'local' starts a cluster on this machine."),
]
JsonOption = Annotated[bool, Option("--json", help="Print the result as one JSON object, described in docs/json.md.")]

CONTROL_OPTIONS = {name: setting for name, setting in CONTROLS.items() if not setting.about.hidden}
"""Controls that have a command line option."""
OTHER_OPTIONS = {
    "count", "crop", "dataset", "distance", "drop_components", "force", "keep", "limits", "log", "manifest", "memory",
    "noise", "retries", "scheduler", "seeds", "split", "timeout", "values", "watch", "weld", "workers",
}  # fmt: skip
"""Further keyword arguments with an option of the same name; no parameter of a method has such a name."""

Command = Callable[..., None]


def setting_name(name: str, value: object = None) -> str:
    """Return the command line option of a setting, for messages; parameters of methods keep their names."""
    if name in CONTROL_OPTIONS:
        option = CONTROL_OPTIONS[name].option
        return option if value is None or CONTROL_OPTIONS[name].about.flag else f"{option} {value}"
    return f"--{name.replace('_', '-')}" if name in OTHER_OPTIONS else name


def control_options(*names: str) -> Callable[[Command], Command]:
    """Add options for all controls, or for the named ones, to a command with keyword arguments `**controls`."""
    settings = [CONTROL_OPTIONS[name] for name in names or CONTROL_OPTIONS]

    def with_options(command: Command) -> Command:
        @wraps(command)
        def run(**arguments: Any) -> None:
            controls = {setting.name: _value(setting, arguments.pop(setting.name)) for setting in settings}
            command(**arguments, **controls)

        own = [p for p in inspect.signature(command).parameters.values() if p.name != "controls"]
        run.__signature__ = inspect.Signature([*own, *map(_option, settings)])  # type: ignore[attr-defined]
        return run

    return with_options


def _option(setting: ControlSetting) -> inspect.Parameter:
    """Return the command argument from which typer generates the option of a control."""
    about = setting.about
    option = Option(
        setting.option,
        help=setting.help(about.words),
        metavar=about.metavar or (None if about.flag else "|".join(map(str, setting.choices))),
        rich_help_panel="Controls",
    )
    kind: Any = str | None
    if about.flag:
        kind = bool
    elif list[str] in setting.kinds:
        kind = list[str] | None
    elif setting.kinds in ((int,), (float,)):
        kind = setting.kind
    default = False if about.flag else setting.default
    return inspect.Parameter(
        setting.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, option]
    )


def _value(setting: ControlSetting, given: Any) -> Any:
    if setting.about.flag:
        return setting.choices[0] if given else None
    return given or None if isinstance(given, list) else given  # some versions of typer pass an empty list


def parameter_values(settings: Sequence[str] | None, model: Path | None = None) -> dict[str, Any]:
    """Read NAME=VALUE pairs and add the weights file; the method checks names and values."""
    values: dict[str, Any] = {name.replace("-", "_"): v for name, v in named_values("--set", settings).items()}
    return values if model is None else {**values, "model": model}


VALUES = {"--result": "DIR", "--command": "'PROG {in} {out}'"}
"""Placeholder for the value in options of the form NAME=VALUE."""


def named_values(option: str, given: Sequence[str] | None) -> dict[str, str]:
    """Read the NAME=VALUE pairs of an option."""
    values: dict[str, str] = {}
    for text in given or ():
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals):
            raise typer.BadParameter(f"{option} {name or equals}: write it as NAME={VALUES.get(option, 'VALUE')}")
        if name in values:
            raise typer.BadParameter(f"{option} {name}: the name is given twice")
        values[name] = value
    return values
