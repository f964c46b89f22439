"""Write files atomically, and to streams that may accept few bytes at once."""

import io
import os
import re
import secrets
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from hashlib import sha256
from pathlib import Path
from selectors import EVENT_WRITE, DefaultSelector
from typing import BinaryIO

from cascadenorm.errors import OutputError
from cascadenorm.io.base import Piece

KEPT_LETTERS = 40  # number of characters of a file name that its temporary file starts with


def check_output(path: Path, *, force: bool) -> None:
    """Raise OutputError if path cannot be written, or if it is an existing file and force is not given."""
    mode = 0
    if path == Path("-"):
        raise OutputError("standard output cannot be used for this output: give the name of a file")
    try:
        target = path.absolute()
    except FileNotFoundError:
        raise OutputError(f"{path} cannot be written: the current folder does not exist any more") from None
    try:
        target = path.resolve()
        mode = target.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError, RuntimeError) as error:  # name too long, null byte in the name, or a cycle of links
        raise OutputError(f"{path} cannot be written: {getattr(error, 'strerror', None) or error}") from None
    if stat.S_ISDIR(mode):
        raise OutputError(f"{path} is a folder: give the name of a file in it")
    folder = target.parent if path.is_symlink() else path.parent
    if not target.parent.is_dir():
        if url := re.match(r"([A-Za-z][A-Za-z0-9+.-]+:/)(.*)", path.as_posix(), re.DOTALL):  # a path loses a slash
            raise OutputError(f"{url[1]}/{url[2]} is a URL: give the name of a local file")
        raise OutputError(f"the folder {folder} does not exist: create it first")
    if stat.S_ISREG(mode) and not force:
        raise OutputError(f"{path} exists already", hint="choose another name", remedy=("force", True))
    if (stat.S_ISREG(mode) or not mode) and not os.access(target.parent, os.W_OK | os.X_OK):
        raise OutputError(
            f"no permission to write in the folder {folder}: choose another one, or change its permissions"
        )


def check_outputs(*paths: Path | None, force: bool) -> None:
    """Check the paths that are not None like `check_output`. Raises OutputError if two of them are the same file."""
    given = [path for path in paths if path is not None]
    for path in given:
        check_output(path, force=force)
    if len({path.resolve() for path in given}) < len(given):
        raise OutputError(f"several outputs are the same file: {', '.join(map(str, given))}", hint="rename one")


def make_folder(folder: Path) -> None:
    """Create a folder and its parents. Raises OutputError if that is impossible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder} is a file: give the name of a folder") from None
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        raise OutputError(f"{folder} cannot be created: {getattr(error, 'strerror', None) or error}") from error


@contextmanager
def making_folder(folder: Path) -> Iterator[None]:
    """Create a folder like `make_folder`; remove it and its new parents, unless they hold files, after an error."""
    new = [place for place in (folder, *folder.parents) if not os.path.lexists(place)]
    make_folder(folder)
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for place in new:
                place.rmdir()
        raise


def is_special(path: str | os.PathLike[str]) -> bool:
    """Whether a path exists that is neither a file nor a folder, such as a pipe or a device."""
    return os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path)


def write_atomically(path: Path, pieces: Iterable[Piece], *, force: bool = False) -> None:
    """Write pieces to a temporary file beside path, then rename it. On failure path is unchanged.

    A link is followed. A special file, such as a pipe or a device, is written directly. With `force`, an existing file
    is replaced, and keeps its permissions. Raises OutputError if the file exists and force is not given, or if it
    cannot be written.
    """
    write_together([(path, pieces)], force=force)


def write_together(files: Sequence[tuple[Path, Iterable[Piece]]], *, force: bool = False) -> None:
    """Write several files like `write_atomically`. All are complete before the first one is renamed.

    Files are renamed in the given order, so the file that references the others should be last. With `force` a path may
    occur twice, with an interim and a final content. Raises OutputError as `write_atomically` does; no new file is left
    behind in this case.
    """
    for path, _ in files:
        check_output(path, force=force)
    staged: list[tuple[Path, str]] = []
    placed: list[Path] = []
    try:
        for path, pieces in files:
            with explained_writing(path):
                if is_special(path):
                    with path.open("wb") as stream:
                        stream.writelines(pieces)
                else:
                    _stage(path.resolve(), pieces, staged, owner=files[-1][0])
        for target, name in staged:
            with explained_writing(target):
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
    """Remove temporary files of outputs and their parts that killed processes have left behind."""
    owners: dict[Path, set[str]] = {}
    for output in outputs:
        owners.setdefault(Path(os.path.realpath(output)).parent, set()).add(_owner_key(output))
    for folder, keys in owners.items():
        for path in folder.glob(".*.part"):
            found = re.fullmatch(r"\..+\.([0-9a-f]{12})\.[0-9a-f]{8}\.part", path.name, re.DOTALL)
            if found and found[1] in keys:
                path.unlink(missing_ok=True)


def unfinished_name(name: str, owner: Path) -> str:
    """Return a new name for an incomplete file that is or belongs to an output, for `remove_unfinished`."""
    return f".{name[:KEPT_LETTERS]}.{_owner_key(owner)}.{secrets.token_hex(4)}.part"


def _owner_key(output: Path) -> str:
    """Return a digest of the whole name of an output. Names may differ only in their extension."""
    return sha256(os.fsencode(os.path.basename(os.path.realpath(output)))).hexdigest()[:12]


@contextmanager
def explained_writing(path: Path) -> Iterator[None]:
    """Convert errors of the operating system to OutputError."""
    try:
        yield
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}") from error


def _stage(target: Path, pieces: Iterable[Piece], staged: list[tuple[Path, str]], *, owner: Path) -> None:
    """Write a temporary file beside its target, with the permissions of the file it replaces, and record both."""
    name = str(target.parent / unfinished_name(target.name, owner))
    mode = target.stat().st_mode & 0o777 if target.exists() else None
    with open(name, "xb", opener=None if mode is None else partial(os.open, mode=mode)) as stream:
        staged.append((target, name))
        stream.writelines(pieces)
        stream.flush()
        os.fsync(stream.fileno())
    if mode is not None:
        os.chmod(name, mode)  # restore bits that the umask removed


def _rename_to_new(name: str, target: Path) -> None:
    """Rename without ever replacing a file that has been created in the meantime."""
    try:
        os.link(name, target)
    except FileExistsError:
        raise OutputError(f"another process created {target} in the meantime: nothing was overwritten") from None
    except OSError:  # a file system without hard links
        check_output(target, force=False)
        os.replace(name, target)


def write_stream(stream: BinaryIO, pieces: Iterable[Piece]) -> None:
    """Write all pieces to a stream, which may be full at times, and flush it. Raises OutputError."""
    try:
        for piece in pieces:
            write_all(stream, piece)
        _flush(stream)
    except BrokenPipeError:
        raise OutputError("the stream was closed by its reader before all was written") from None
    except OSError as error:
        raise OutputError(f"the stream cannot be written: {error.strerror or error}") from error


def write_all(stream: BinaryIO | io.RawIOBase, piece: Piece) -> None:
    """Write a whole piece to a stream, which may accept fewer bytes at once."""
    left = memoryview(piece).cast("B")
    while len(left):
        try:
            written = stream.write(left)
        except BlockingIOError as error:
            written = error.characters_written
            _wait(stream)
        if isinstance(stream, io.RawIOBase) and written is None:  # the stream is full
            _wait(stream)
            continue
        left = left[len(left) if written is None else written :]


def _flush(stream: BinaryIO) -> None:
    while True:
        try:
            stream.flush()
            return
        except BlockingIOError:
            _wait(stream)


def _wait(stream: BinaryIO | io.RawIOBase) -> None:
    """Wait until a stream accepts bytes again."""
    with DefaultSelector() as selector:
        selector.register(stream, EVENT_WRITE)
        selector.select()
