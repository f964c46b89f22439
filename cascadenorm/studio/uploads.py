"""Files that were dropped on the page; they lie in a folder of their own until the studio ends."""

from collections.abc import AsyncIterator
from pathlib import Path
from shutil import rmtree

from cascadenorm.errors import OutputError, ReadError
from cascadenorm.studio.names import plain_name


class TooLarge(ReadError):
    """A file of more bytes than the studio takes."""


class Uploads:
    """Folders of files that were dropped together, such as an OBJ file with its materials.

    Parameters
    ----------
    folder
        In which there is one for each drop.
    most
        Bytes of all drops together, beside the one that is open.
    """

    def __init__(self, folder: Path, *, most: int) -> None:
        self._folder, self._most = folder, most
        self._open: int | None = None

    def path(self, drop: int, name: object) -> Path:
        """Return where a file of a drop lies; raises OutputError for a name that is a path."""
        return self._folder / str(drop) / plain_name(name)

    async def take(self, drop: int, name: object, parts: AsyncIterator[bytes], *, announced: int) -> None:
        """Write a file as it comes.

        Raises
        ------
        TooLarge
            What was dropped and is not open has too many bytes; nothing is kept of the file.
        OutputError
            The name is a path, or there is no room for the file.
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
        except TooLarge:
            path.unlink()
            raise
        except OSError as error:
            path.unlink(missing_ok=True)
            raise OutputError(f"{path.name} cannot be received: {error.strerror or error}") from error

    def opened(self, drop: int) -> None:
        """Remove every drop but one, whose mesh is open now."""
        self._open = drop
        for other in self._folder.iterdir():
            if other.name != str(drop):
                rmtree(other, ignore_errors=True)

    def refused(self, drop: int) -> None:
        """Remove a drop that was not opened."""
        if drop != self._open:
            rmtree(self._folder / str(drop), ignore_errors=True)


def check_size(name: str, size: int, room: int, most: int) -> None:
    """Raise TooLarge where a file does not fit."""
    if size > room:
        raise TooLarge(
            f"{name} is larger than the studio takes, {most / 1e6:g} MB",
            hint="start it with a larger --max-size, or use `cascadenorm denoise`, which has no limit",
        )
