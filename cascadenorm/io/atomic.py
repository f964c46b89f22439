"""Write a file whole or not at all."""

import os
import stat
import tempfile
from collections.abc import Iterable
from pathlib import Path

from cascadenorm.io.contract import OutputError, Piece


def check_output(path: Path, *, force: bool) -> None:
    """Raise OutputError where nothing can be written to path, or a file is there and force is not given."""
    mode = 0
    try:
        target = path.resolve()
        mode = target.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError, RuntimeError) as error:  # too long a name, a zero byte in it, links in a circle
        raise OutputError(f"{path} cannot be written: {getattr(error, 'strerror', None) or error}") from None
    if stat.S_ISDIR(mode):
        raise OutputError(f"{path} is a folder: give the name of a file in it")
    folder = target.parent if path.is_symlink() else path.parent
    if not target.parent.is_dir():
        raise OutputError(f"the folder {folder} does not exist: create it first")
    if stat.S_ISREG(mode) and not force:
        raise OutputError(f"{path} exists already: choose another name, or overwrite it with force (--force)")
    if (stat.S_ISREG(mode) or not mode) and not os.access(target.parent, os.W_OK | os.X_OK):
        raise OutputError(f"nothing can be written in the folder {folder}: choose another one, or ask for access")


def write_atomically(path: Path, pieces: Iterable[Piece], *, force: bool = False) -> None:
    """Write pieces to a temporary file beside path, then rename it; on failure path is as it was before.

    Parameters
    ----------
    path : a link is followed; what is no ordinary file (a pipe, a device) is written to directly
    force : replace an existing file, keeping its permissions

    Raises
    ------
    OutputError : the file exists and force is not given, or it cannot be written
    """
    check_output(path, force=force)
    try:
        target = path.resolve()
        if target.exists() and not target.is_file():
            with target.open("wb") as stream:
                stream.writelines(pieces)
            return
        _replace(target, pieces, force=force)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}") from error


def _replace(target: Path, pieces: Iterable[Piece], *, force: bool) -> None:
    handle, name = tempfile.mkstemp(prefix=f".{target.name[:100]}.", suffix=".part", dir=target.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.writelines(pieces)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(name, _mode(target))
        if force:
            os.replace(name, target)
        else:
            _rename_to_new(name, target)
    finally:
        Path(name).unlink(missing_ok=True)


def _rename_to_new(name: str, target: Path) -> None:
    """Rename without ever replacing a file that has appeared in the meantime."""
    try:
        os.link(name, target)
    except FileExistsError:
        raise OutputError(f"{target} has appeared while it was being written: nothing was overwritten") from None
    except OSError:  # a file system without hard links
        check_output(target, force=False)
        os.replace(name, target)


def _mode(target: Path) -> int:
    """Return the permissions of the file to be replaced, or those that a new file gets."""
    if target.exists():
        return target.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
