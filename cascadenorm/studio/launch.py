"""Starting the studio."""

from os import PathLike

from cascadenorm.errors import MissingDependencyError

MOST_MEGABYTES = 1000
"""Size of the largest file that is opened unless another is given."""


def studio(
    file: str | PathLike[str] | None = None, *, port: int = 0, browser: bool = True, max_size: float = MOST_MEGABYTES
) -> None:
    """Serve the studio until its last page is closed, or Ctrl-C.

    Parameters
    ----------
    file
        Mesh file to open; None lets the user drop one.
    port
        On the loopback interface; 0 takes one that is free.
    browser
        Open the page in the user's browser; its address is printed in any case.
    max_size
        Of a file, in megabytes.

    Raises
    ------
    ReadError
        The file does not exist or is too large; what is wrong within it is told on the page.
    OutputError
        The port is taken.
    MissingDependencyError
        Starlette or uvicorn is not installed.
    """
    try:
        from cascadenorm.studio import server
    except ModuleNotFoundError as error:
        raise MissingDependencyError("the studio", package=error.name or "uvicorn", extra="studio") from None
    server.serve(file, port=port, browser=browser, most=int(max_size * 1e6))
