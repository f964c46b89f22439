"""The root command of the command line, with its version option."""

from typing import Annotated

import typer

app = typer.Typer(
    name="cascadenorm",
    help="Denoise triangle meshes by cascaded normal regression, or by one of the classical methods.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def options(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    """Denoise triangle meshes by cascaded normal regression or by a classical method."""
    if version:
        from cascadenorm.version import __version__

        print(f"cascadenorm {__version__}")
        raise typer.Exit
