"""Starting the studio."""

from os import PathLike

from cascadenorm.errors import MissingDependencyError

MOST_MEGABYTES = 1000
"""Default size limit of files."""


def studio(
    file: str | PathLike[str] | None = None, *, port: int = 0, browser: bool = True, max_size: float = MOST_MEGABYTES
) -> None:
    """Serve the studio until its last page is closed, or Ctrl-C.

    Parameters
    ----------
    file
        Mesh file to open; None lets the user drop one.
    port
        Port on the loopback interface; 0 selects a free one.
    browser
        Whether to open the page in the default browser. Its address is printed in any case.
    max_size
        Size limit of files, in megabytes.

    Raises
    ------
    ReadError
        The file does not exist, is too large, or is not a mesh.
    MeshError
        The file has no faces. Invalid vertices and faces are isolated instead.
    OutputError
        The port is in use.
    MissingDependencyError
        Starlette or uvicorn is not installed.
    """
    try:
        from cascadenorm.studio import server
    except ModuleNotFoundError as error:
        raise MissingDependencyError("the studio", package=error.name or "uvicorn", extra="studio") from None
    server.serve(file, port=port, browser=browser, most=int(max_size * 1e6))
