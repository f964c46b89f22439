"""The command that opens the studio in the browser."""

from pathlib import Path
from typing import Annotated

import typer

from cascadenorm.cli.app import app


@app.command()
def studio(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="Mesh file. You can also drop one onto the page.")
    ] = None,
    *,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the local server; 0 selects a free port.")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Whether to open the page in the browser.")
    ] = True,
    max_size: Annotated[
        float, typer.Option(min=0, metavar="MB", help="Largest file size that is accepted, in megabytes.")
    ] = 1000,
) -> None:
    """Denoise in the browser: preview the result as you change settings, paint masks, and save."""
    from cascadenorm.studio import studio

    studio(file, port=port, browser=browser, max_size=max_size)
