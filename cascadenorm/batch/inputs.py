"""List the input files of a batch and the paths of their results."""

import os
from collections.abc import Container, Iterable, Iterator, Sequence
from contextlib import suppress
from glob import escape, glob, has_magic
from itertools import takewhile
from os import PathLike
from pathlib import Path, PurePath
from typing import NamedTuple

from cascadenorm.batch.remote_files import file_name, files_at, fixed_part, without_query
from cascadenorm.errors import OutputError, ReadError
from cascadenorm.io import is_mesh_name
from cascadenorm.io.files import is_url

RESULT_NAME = "_denoised"  # suffix that `denoise` adds to the stem of a file name

Sources = str | PathLike[str] | Sequence[str | PathLike[str]]
"""One or several files, folders or patterns such as "scans/**/*.ply"."""


class Job(NamedTuple):
    """A file to be denoised."""

    # source, output: paths or URLs
    source: str
    output: str
    size: int  # of the source in bytes
    # modification time of the source in nanoseconds; for a URL, a text that changes with its content; None if the
    # source does not exist
    changed: int | str | None


def find_jobs(
    sources: Sources, folder: str | Path, format: str | None = None, *, skipped: list[str] | None = None
) -> list[Job]:
    """List the files that exist now, with the paths of their results, largest first.

    Names of single files are used as they are; folders and patterns select files with the extension of a mesh format.
    Results keep the folder structure of the sources below their common folder, which for a pattern is the part before
    the first wildcard, and the format of each source if none is given. Files in the output folder, a path or URL, are
    not read, nor are results that `denoise` wrote beside their sources, whose names are added to `skipped`. Raises
    ReadError if only some of the sources are URLs, or if a server does not answer.
    """
    places = source_names(sources)
    remote = list(map(is_url, places))
    if any(remote) and not all(remote):
        raise ReadError("some sources are URLs and others are not: denoise them in separate batches")
    jobs: dict[str, Job] = {}
    left: list[str] = [] if skipped is None else skipped
    found = _remote(places, str(folder), left) if any(remote) else _local(places, Path(folder).resolve(), left)
    for identity, job in found:
        if identity in jobs:
            continue
        inside = PurePath(job.output) if format is None else PurePath(job.output).with_suffix(f".{format}")
        output = f"{folder}/{inside.as_posix()}" if is_url(folder) else str(Path(folder, inside))
        jobs[identity] = job._replace(output=output)
    return sorted(jobs.values(), key=lambda job: (-job.size, job.source))


def _local(places: Sequence[str], results: Path, skipped: list[str]) -> Iterator[tuple[str, Job]]:
    """Yield the identity of each local file and its job, whose output is the path below the common folder.

    Results of `denoise` are added to `skipped`.
    """
    base = _common([_fixed_part(place) for place in places])
    folders: dict[Path, Path] = {}
    left: list[str] = []
    for path in (path for place in places for path in _files(place, left)):
        if path.parent not in folders:
            folders[path.parent] = Path(os.path.realpath(path.parent))  # once per folder: network shares are slow
        real = Path(os.path.realpath(path)) if os.path.islink(path) else folders[path.parent] / path.name
        if results not in real.parents:
            yield str(real), Job(str(path), os.path.relpath(path.absolute(), base), *_state(path))
    skipped += [name for name in dict.fromkeys(left) if results not in Path(os.path.realpath(name)).parents]


def _remote(places: Sequence[str], results: str, skipped: list[str]) -> Iterator[tuple[str, Job]]:
    """Yield files at URLs like `_local`."""
    parts = [fixed_part(place).split("/") for place in places]
    shared = [names[0] for names in takewhile(lambda names: len(set(names)) == 1, zip(*parts, strict=False))]
    base = "/".join(shared)
    if len(shared) < 3:  # "s3:", "", "bucket"
        raise ReadError("the files lie in several buckets or servers: denoise them in separate batches")
    for place in places:
        found = files_at(place)
        names = {file.url for file in found}
        for file in found:
            if file.url.startswith(f"{results}/"):
                continue
            if file.url != place and _is_result(file.url, names):
                skipped.append(file.url)
            elif file.url == place or is_mesh_name(Path(file_name(file.url))):
                inside = without_query(file.url).removeprefix(f"{base}/")
                yield file.url, Job(file.url, inside, file.size, file.version)


def check_sources(sources: Sequence[str], folder: str | Path, jobs: Sequence[Job]) -> None:
    """Reject a batch without files with ReadError, and one with two files of the same output path with OutputError."""
    if not jobs:
        raise ReadError(
            f"{', '.join(sources)}: no mesh files were found (those in the output folder {folder} are not read)",
            hint='check the names, and quote patterns, such as "scans/**/*.ply"',
        )
    owners: dict[str, Job] = {}
    for job in sorted(jobs):
        if owners.setdefault(job.output, job) is not job:
            raise same_output(owners[job.output], job)


def same_output(one: Job, other: Job) -> OutputError:
    """Return the error for two files with the same output path."""
    return OutputError(
        f"{one.source} and {other.source} would both be written to {one.output}",
        hint="rename one, or denoise them in separate batches",
    )


def source_names(sources: Sources) -> list[str]:
    """Return the names of one or several sources. Raises ReadError if there are none."""
    names = [str(sources)] if isinstance(sources, str | PathLike) else [str(source) for source in sources]
    if not names:
        raise ReadError("no files are given", hint="give at least one file, folder or pattern")
    if "" in names:
        raise ReadError("the name of a source is empty", hint="name a file, folder or pattern")
    return names


def _state(path: Path) -> tuple[int, int | None]:
    """Return size and modification time; the time of a missing file is None, and processing it raises the error."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return 0, None
    return found.st_size, found.st_mtime_ns


def _files(place: str, skipped: list[str]) -> Iterable[Path]:
    """List the files of a source; add results of `denoise` beside their sources to `skipped`."""
    if has_magic(place) and not os.path.exists(place):
        found = [Path(name) for name in sorted(set(_glob(place)))]
    elif os.path.isdir(place):
        found = []
        for parent, folders, inside in os.walk(place, onerror=_unlisted):
            folders[:] = [name for name in folders if name[0] != "."]  # as patterns do
            found += [Path(parent, name) for name in inside if name[0] != "."]
        found.sort()
    else:
        return [Path(place)]
    names = {str(path) for path in found}
    files = [path for path in found if is_mesh_name(path) and _may_be_file(path)]
    results = {path for path in files if _is_result(str(path), names)}
    skipped += sorted(map(str, results))
    return [path for path in files if path not in results]


def _glob(pattern: str) -> Iterator[str]:
    """Yield what a pattern matches, like `glob` with `recursive`, but without following links around in loops."""
    parts = Path(pattern).parts
    if "**" not in parts:
        yield from glob(pattern)
        return
    at = parts.index("**")
    for start in glob(os.path.join(*parts[:at])) if at else [""]:
        for folder in _folders(start, ()):
            yield from _glob(os.path.join(escape(folder), *(parts[at + 1 :] or ["*"])))


def _folders(folder: str, outer: tuple[str, ...]) -> Iterator[str]:
    """Yield a folder and those in it that are not hidden; a link to one of the folders around it is not followed."""
    real = os.path.realpath(folder)
    if real in outer:
        return
    yield folder
    inside: list[str] = []
    with suppress(OSError), os.scandir(folder or os.curdir) as entries:  # patterns skip folders that cannot be listed
        shown = [entry for entry in entries if entry.name[0] != "."]
        inside = [e.name for e in shown if (os.path.isdir(e.path) if e.is_symlink() else e.is_dir())]
    for name in sorted(inside):
        yield from _folders(os.path.join(folder, name), (*outer, real))


def _is_result(name: str, names: Container[str]) -> bool:
    """Test whether `denoise` wrote a file beside one of the others, such as scan_denoised.ply beside scan.ply."""
    stem, suffix = os.path.splitext(name)
    return stem.endswith(RESULT_NAME) and f"{stem.removesuffix(RESULT_NAME)}{suffix}" in names


def _unlisted(error: OSError) -> None:
    """Raise ReadError for a folder that cannot be listed, unless it was removed meanwhile."""
    if not isinstance(error, FileNotFoundError):
        raise ReadError(
            f"{error.filename} cannot be listed: {error.strerror or error}",
            hint="try again, or name the files by a pattern that leaves it out",
        ) from error


def _may_be_file(path: Path) -> bool:
    """Test for a file; if a network share does not answer, assume one, so that processing it reports the error."""
    try:
        return path.is_file()
    except OSError:
        return True


def _fixed_part(place: str) -> Path:
    """Return the folder that contains all files of a source."""
    path = Path(os.path.abspath(place))  # without "..", which would place results outside the output folder
    if os.path.isdir(place):
        return path
    if os.path.exists(place) or not has_magic(place):
        return path.parent
    return next(parent for parent in path.parents if not has_magic(str(parent)))


def _common(folders: Sequence[Path]) -> Path:
    try:
        return Path(os.path.commonpath(folders))
    except ValueError:  # on several drives
        raise ReadError("the files are on different drives: denoise those of each drive in a separate batch") from None
