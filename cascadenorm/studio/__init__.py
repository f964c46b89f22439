"""The studio: denoising in a browser, with a server that only this machine can reach."""

from os import PathLike

from cascadenorm.errors import MissingDependencyError

MOST_MEGABYTES = 1000  # default size limit of files


def studio(
    file: str | PathLike[str] | None = None, *, port: int = 0, browser: bool = True, max_size: float = MOST_MEGABYTES
) -> None:
    """Serve the studio, as the command of this name does, until its last page is closed, or Ctrl-C.

    Raises ReadError if the file does not exist, is too large or is not a mesh, MeshError if it has no faces,
    OutputError if the port is in use, and MissingDependencyError if starlette or uvicorn is not installed.
    """
    try:
        from cascadenorm.studio import server
    except ModuleNotFoundError as error:
        raise MissingDependencyError("the studio", package=error.name or "uvicorn", extra="studio") from None
    server.serve(file, port=port, browser=browser, most=max_size * 1e6)
