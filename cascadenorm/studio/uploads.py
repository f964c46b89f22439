"""Files that were dropped on the page, kept in a temporary folder until the studio ends."""

from collections.abc import AsyncIterator
from pathlib import Path
from shutil import rmtree

from cascadenorm.errors import OutputError, ReadError
from cascadenorm.studio.names import plain_name


class TooLarge(ReadError):
    """A file exceeds the size limit of the studio."""


class Uploads:
    """Folders for files that were dropped together, at most `most` bytes in all, without those of the open mesh."""

    def __init__(self, folder: Path, *, most: float) -> None:
        self._folder, self._most = folder, most
        self._open: int | None = None

    def path(self, drop: int, name: object) -> Path:
        """Return the path of a dropped file; raise OutputError for a name with folders."""
        return self._folder / str(drop) / plain_name(name)

    async def take(self, drop: int, name: object, parts: AsyncIterator[bytes], *, announced: int) -> None:
        """Write a file as it is received.

        Raises TooLarge if the dropped files that are not open have too many bytes, and OutputError if the name has
        folders, or if the file cannot be written. Nothing of the file is kept unless all of it is received.
        """
        path = self.path(drop, name)
        path.parent.mkdir(exist_ok=True)
        kept = None if self._open is None else self._folder / str(self._open)
        others = (other for other in self._folder.glob("*/*") if other != path and other.parent != kept)
        room = self._most - sum(other.stat().st_size for other in others)
        check_size(path.name, announced, room, self._most)
        taken = 0
        try:
            with path.open("wb") as stream:
                async for part in parts:
                    taken += len(part)
                    check_size(path.name, taken, room, self._most)
                    stream.write(part)
        except BaseException as error:  # also if the page is closed while it sends
            path.unlink(missing_ok=True)
            if not isinstance(error, OSError):
                raise
            raise OutputError(f"{path.name} cannot be received: {error.strerror or error}") from error

    def opened(self, drop: int) -> None:
        """Remove the drops before the one whose mesh is open; another page may still send or open a later one."""
        self._open = drop
        for other in self._folder.iterdir():
            if int(other.name) < drop:
                rmtree(other, ignore_errors=True)

    def refused(self, drop: int) -> None:
        """Remove a drop that was not opened."""
        if drop != self._open:
            rmtree(self._folder / str(drop), ignore_errors=True)


def check_size(name: str, size: int, room: float, most: float) -> None:
    """Raise TooLarge if a file exceeds the available room."""
    if size > room:
        raise TooLarge(
            f"{name} exceeds the limit of the studio, {most / 1e6:g} MB",
            hint="start the studio with a larger --max-size, or use `cascadenorm denoise`, which has no limit",
        )
