"""Use of other libraries: whether they are installed, their errors, and archives."""

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from zipfile import ZipFile

from cascadenorm.errors import CascadenormError, ReadError, reason
from cascadenorm.io.limits import check_expansion


def is_installed(module: str) -> bool:
    """Whether a module can be imported."""
    return importlib.util.find_spec(module) is not None


@contextmanager
def explained(
    problem: str, kind: type[CascadenormError] = ReadError, *, hint: str = "", said: Callable[[Exception], str] = reason
) -> Iterator[None]:
    """Convert the errors of another library, which may have any type, to ours. `said` returns their message."""
    try:
        yield
    except CascadenormError:
        raise
    except Exception as error:
        raise kind(f"{problem}: {said(error)}", hint=hint) from None


def unzipped(data: bytes, format: str, wanted: Callable[[str], bool] = lambda name: True) -> list[tuple[str, bytes]]:
    """Return the names and contents of the wanted files in an archive.

    Raises ReadError if the archive is damaged, or if its files are too large by their declared sizes. No more is ever
    read.
    """
    with explained(f"this {format} file is a damaged archive"), ZipFile(BytesIO(data)) as archive:
        entries = [entry for entry in archive.infolist() if not entry.is_dir()]
        check_expansion(sum(entry.file_size for entry in entries), len(data), "the files in this archive")
        return [(entry.filename, archive.read(entry)) for entry in entries if wanted(entry.filename)]
