"""Write a file whole or not at all."""

import os
import re
import secrets
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from hashlib import sha256
from pathlib import Path

from cascadenorm.errors import OutputError
from cascadenorm.io.base import Piece

NAMED = 40
"""Characters of the name of a file that its temporary file is called by."""


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
        raise OutputError(f"{path} exists already", hint="choose another name", remedy=("force", True))
    if (stat.S_ISREG(mode) or not mode) and not os.access(target.parent, os.W_OK | os.X_OK):
        raise OutputError(
            f"no permission to write in the folder {folder}: choose another one, or change its permissions"
        )


def make_folder(folder: Path) -> None:
    """Make a folder, and those that it lies in; raises OutputError where that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder} is a file: give the name of a folder") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise OutputError(f"{folder} cannot be created: {getattr(error, 'strerror', None) or error}") from error


def is_special(path: str | os.PathLike[str]) -> bool:
    """Test whether something is there that is neither a file nor a folder: a pipe, a device."""
    return os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path)


def write_atomically(path: Path, pieces: Iterable[Piece], *, force: bool = False) -> None:
    """Write pieces to a temporary file beside path, then rename it; on failure path is as it was before.

    Parameters
    ----------
    path
        A link is followed; what is no ordinary file (a pipe, a device) is written to directly.
    force
        Replace an existing file, keeping its permissions.

    Raises
    ------
    OutputError
        The file exists and force is not given, or it cannot be written.
    """
    write_together([(path, pieces)], force=force)


def write_together(files: Sequence[tuple[Path, Iterable[Piece]]], *, force: bool = False) -> None:
    """Write several files as `write_atomically` does: none gets its name before all are complete.

    Parameters
    ----------
    files
        They get their names in this order, the last is the one that the others belong to; with `force` a path may come
        twice, as what it is meanwhile and at last.
    force
        Replace existing files.

    Raises
    ------
    OutputError
        One exists and force is not given, or cannot be written; none of them is new then.
    """
    for path, _ in files:
        check_output(path, force=force)
    staged: list[tuple[Path, str]] = []
    placed: list[Path] = []
    try:
        for path, pieces in files:
            with _explained(path):
                if is_special(path):
                    with path.open("wb") as stream:
                        stream.writelines(pieces)
                else:
                    _stage(path.resolve(), pieces, staged, owner=files[-1][0])
        for target, name in staged:
            with _explained(target):
                if force:
                    os.replace(name, target)
                else:
                    _rename_to_new(name, target)
                    placed.append(target)
    except BaseException:
        for target in placed:
            target.unlink(missing_ok=True)
        raise
    finally:
        for _, name in staged:
            Path(name).unlink(missing_ok=True)


def remove_unfinished(outputs: Iterable[Path]) -> None:
    """Remove the temporary files of outputs whose process was killed while it wrote them, with those beside them."""
    owners: dict[Path, set[str]] = {}
    for output in outputs:
        owners.setdefault(Path(os.path.realpath(output)).parent, set()).add(_owner_key(output))
    for folder, keys in owners.items():
        for path in folder.glob(".*.part"):
            found = re.fullmatch(r"\..+\.([0-9a-f]{12})\.[0-9a-f]{8}\.part", path.name, re.DOTALL)
            if found and found[1] in keys:
                path.unlink(missing_ok=True)


def unfinished_name(name: str, owner: Path) -> str:
    """Return a new name for a file that is not complete, from which `remove_unfinished` knows the output it belongs to.

    Parameters
    ----------
    name
        What the file will be called.
    owner
        The output that it is, or is a part of.
    """
    return f".{name[:NAMED]}.{_owner_key(owner)}.{secrets.token_hex(4)}.part"


def _owner_key(output: Path) -> str:
    """Return a digest of the whole name of an output: others may begin alike, or differ in their extension alone."""
    return sha256(os.fsencode(os.path.basename(os.path.realpath(output)))).hexdigest()[:12]


@contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Turn errors of the operating system into our own."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}") from error


def _stage(target: Path, pieces: Iterable[Piece], staged: list[tuple[Path, str]], *, owner: Path) -> None:
    """Write a complete temporary file beside its target, which belongs to `owner`, and note both.

    It has the permissions of the file that it replaces, or those that the process gives to new files.
    """
    name = str(target.parent / unfinished_name(target.name, owner))
    mode = target.stat().st_mode & 0o777 if target.exists() else None
    with open(name, "xb", opener=None if mode is None else partial(os.open, mode=mode)) as stream:
        staged.append((target, name))
        stream.writelines(pieces)
        stream.flush()
        os.fsync(stream.fileno())
    if mode is not None:
        os.chmod(name, mode)  # bits that the umask took away


def _rename_to_new(name: str, target: Path) -> None:
    """Rename without ever replacing a file that has appeared in the meantime."""
    try:
        os.link(name, target)
    except FileExistsError:
        raise OutputError(f"another process created {target} in the meantime: nothing was overwritten") from None
    except OSError:  # a file system without hard links
        check_output(target, force=False)
        os.replace(name, target)
