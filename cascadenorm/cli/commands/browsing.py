"""Commands that open a page in the browser."""

from pathlib import Path
from typing import Annotated

import typer

from cascadenorm.cli.app import app


@app.command()
def studio(
    file: Annotated[Path | None, typer.Argument(metavar="[FILE]", help="Mesh file; or drop one on the page.")] = None,
    *,
    port: Annotated[int, typer.Option(min=0, max=65535, help="On this machine; 0 takes one that is free.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
    max_size: Annotated[float, typer.Option(min=0, metavar="MB", help="Size of the largest file.")] = 1000,
) -> None:
    """Denoise in the browser: see the answer while you choose, paint what stays, save."""
    from cascadenorm.studio import studio

    studio(file, port=port, browser=browser, max_size=max_size)
