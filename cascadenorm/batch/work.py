"""The work of a process on one file: check whether it is done already, denoise it."""

import errno
import hashlib
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from cascadenorm import api, io
from cascadenorm.batch.inputs import Job
from cascadenorm.batch.manifest import Line
from cascadenorm.denoised_files import DenoisingSummary
from cascadenorm.digests import file_digest
from cascadenorm.errors import OutputError, ReadError
from cascadenorm.io.atomic import check_output

FULL = (errno.ENOSPC, errno.EDQUOT)


@dataclass(frozen=True)
class Settings:
    """What is done to every file.

    Parameters
    ----------
    method, parameters, controls, force : as in `denoise_file`
    key : digest of all that a result depends on, but the file
    """

    method: str
    parameters: Mapping[str, Any]
    controls: Mapping[str, Any]
    force: bool
    key: str


class Task(NamedTuple):
    """A file to be checked, or to be denoised.

    Parameters
    ----------
    line : its last line in the manifest before
    digest : of the file, once it is checked; None asks for the check
    """

    job: Job
    line: Line | None
    digest: str | None = None


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a file.

    Parameters
    ----------
    status : "new" after a check, "kept" where it is done already; "done" or "failed"
    input_digest, output_digest : where they are known
    summary : what was done
    error : what it failed with
    then : what to do after a failure; "stop" where the disk is full
    seconds : all together, reading and writing included
    """

    status: Literal["new", "kept", "done", "failed"]
    input_digest: str | None = None
    output_digest: str | None = None
    summary: DenoisingSummary | None = None
    error: Exception | None = None
    then: Literal["go on", "again", "stop"] = "go on"
    seconds: float = 0.0


class _Changed(ReadError):
    """A file that was written to while it was read."""


def work(settings: Settings, task: Task) -> Outcome:
    """Check a file, or denoise it; what goes wrong is an outcome."""
    start = time.perf_counter()
    try:
        return _denoised(settings, task, start) if task.digest else _checked(settings, task)
    except Exception as error:  # one bad file stops no other
        return Outcome(
            status="failed",
            input_digest=task.digest,
            error=error,
            then=_after(error),
            seconds=time.perf_counter() - start,
        )


def mesh_digest(path: Path) -> str:
    """Return the digest of a mesh file, and of the buffers that a glTF file keeps in other files."""
    if path.suffix.lower() != ".gltf":
        return file_digest(path)
    parts = [path.parent / name for name, needed in io.read(path).refers_to().items() if needed]
    return hashlib.sha256("".join(map(file_digest, [path, *parts])).encode()).hexdigest()


def _checked(settings: Settings, task: Task) -> Outcome:
    """Tell whether the last line says that the same was done, and the result is still there."""
    source, output, line = Path(task.job.source), Path(task.job.output), task.line
    try:
        digest = mesh_digest(source)
    except OSError as error:
        raise ReadError(f"{source} cannot be read: {error.strerror or error}") from error
    if output.exists():  # before the `started` line, which marks an existing file as ours
        check_output(output, force=settings.force or _is_ours(line, output))
    if line is None or line["status"] != "done" or line["settings"] != settings.key or line["input_sha256"] != digest:
        return Outcome(status="new", input_digest=digest)
    kept = output.is_file() and mesh_digest(output) == line["output_sha256"]
    return Outcome(status="kept" if kept else "new", input_digest=digest)


def _denoised(settings: Settings, task: Task, start: float) -> Outcome:
    source, output = Path(task.job.source), Path(task.job.output)
    _make_folder(output.parent)
    summary = api.denoise_file(
        source,
        output,
        method=settings.method,
        parameters=dict(settings.parameters),
        force=settings.force or _is_ours(task.line, output),
        **settings.controls,
    )
    if mesh_digest(source) != task.digest:
        output.unlink(missing_ok=True)
        raise _Changed(f"{source} changed while it was read", hint="try again when it is complete")
    return Outcome(
        status="done",
        input_digest=task.digest,
        output_digest=mesh_digest(output),
        summary=summary,
        seconds=time.perf_counter() - start,
    )


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder} cannot be created: {error.strerror or error}") from error


def _is_ours(line: Line | None, output: Path) -> bool:
    """Whether a file that is there is a result of the batch, which a further one may replace."""
    if line is None or not output.is_file():
        return False
    return bool(line["status"] == "started") or mesh_digest(output) == line["output_sha256"]


def _after(error: Exception) -> Literal["go on", "again", "stop"]:
    cause = error.__cause__ or error
    if isinstance(cause, OSError) and cause.errno in FULL:
        return "stop"
    passing = isinstance(error, MemoryError | _Changed) or (isinstance(cause, OSError) and cause is not error)
    return "again" if passing and not isinstance(cause, FileNotFoundError | PermissionError) else "go on"
