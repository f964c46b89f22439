"""The input files of a batch, and the paths of their results."""

import os
from collections.abc import Iterable, Sequence
from glob import glob, has_magic
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from cascadenorm.errors import OutputError, ReadError
from cascadenorm.io import is_mesh_name

Sources = str | PathLike[str] | Sequence[str | PathLike[str]]
"""Files, folders, or patterns such as "scans/**/*.ply"; one or several."""


class Job(NamedTuple):
    """A file to be denoised.

    Parameters
    ----------
    source, output : paths
    size, changed : of the source, in bytes and in nanoseconds
    """

    source: str
    output: str
    size: int
    changed: int


def find_jobs(sources: Sources, folder: Path, format: str | None = None) -> list[Job]:
    """List the files that are there now, with the places of their results, largest first.

    Below the folder of results the files lie as below the folder that all sources have in common, the part before
    the first wildcard of a pattern. Files in the folder of results are no input.

    Parameters
    ----------
    sources : those that name one file are taken as they are; patterns and folders give files that can be meshes by
        their extension
    folder : of the results
    format : of the results; None keeps that of each source

    Raises
    ------
    OutputError : two files have the same output path
    """
    places = listed(sources)
    base = _common([_fixed_part(place) for place in places])
    results = folder.resolve()
    jobs: dict[Path, Job] = {}
    outputs: dict[str, str] = {}
    for path in (path for place in places for path in _files(place)):
        real = path.resolve()
        if real in jobs or results in real.parents:
            continue
        output = folder / os.path.relpath(path.absolute(), base)
        if format is not None:
            output = output.with_suffix(f".{format}")
        if str(output) in outputs:
            raise OutputError(
                f"{outputs[str(output)]} and {path} would both be written to {output}",
                hint="rename one, or denoise them in separate batches",
            )
        outputs[str(output)] = str(path)
        state = _state(path)
        jobs[real] = Job(str(path), str(output), *state)
    return sorted(jobs.values(), key=lambda job: (-job.size, job.source))


def check_sources(sources: Sources, folder: Path, jobs: Sequence[Job]) -> None:
    """Raise ReadError where there is no file."""
    if not jobs:
        named = ", ".join(listed(sources))
        raise ReadError(
            f"{named}: no mesh files were found (those in the output folder {folder} are not read)",
            hint='check the names, and quote patterns, such as "scans/**/*.ply"',
        )


def listed(sources: Sources) -> list[str]:
    """Return the names of one or several sources."""
    return [str(sources)] if isinstance(sources, str | PathLike) else [str(source) for source in sources]


def all_absolute(places: Iterable[str | PathLike[str]], values: Iterable[object]) -> bool:
    """Test whether names of files mean the same in any working folder: places, and values that are files."""
    files = [value for value in values if isinstance(value, str | PathLike) and os.path.exists(value)]
    return all(map(os.path.isabs, [*places, *files]))


def _state(path: Path) -> tuple[int, int]:
    """Size and time of change; 0 where there is no file, which the work itself will say."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return 0, 0
    return found.st_size, found.st_mtime_ns


def _files(place: str) -> Iterable[Path]:
    if has_magic(place) and not os.path.exists(place):
        found = [Path(name) for name in sorted(glob(place, recursive=True))]
    elif os.path.isdir(place):
        found = [Path(parent, name) for parent, _, names in os.walk(place) for name in names if name[0] != "."]
        found.sort()
    else:
        return [Path(place)]
    return [path for path in found if is_mesh_name(path) and path.is_file()]


def _fixed_part(place: str) -> Path:
    """Return the folder below which a source can have files."""
    if os.path.isdir(place):
        return Path(place).absolute()
    path = Path(place).absolute()
    if os.path.exists(place) or not has_magic(place):
        return path.parent
    return next(parent for parent in path.parents if not has_magic(str(parent)))


def _common(folders: Sequence[Path]) -> Path:
    try:
        return Path(os.path.commonpath(folders))
    except ValueError:  # on several drives
        raise ReadError("the files are on different drives: denoise those of each drive in a separate batch") from None
