"""Check the settings of a batch, check each of its files, and denoise the file if necessary."""

import errno
import hashlib
import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, NamedTuple

import numpy as np

from cascadenorm import io
from cascadenorm.api import api
from cascadenorm.api.opened_files import DenoisingSummary
from cascadenorm.batch.inputs import Job
from cascadenorm.batch.manifest import Line
from cascadenorm.batch.referenced_files import Digests, are_current, check_copies, copies_beside
from cascadenorm.batch.remote_files import ChangedError, exists, fetched, file_name, upload
from cascadenorm.errors import CascadenormError, OutputError, ParameterError, ReadError, WorkerError
from cascadenorm.execution.progress import Listener
from cascadenorm.io.atomic import check_output, make_folder
from cascadenorm.io.digests import file_digest, source_digest
from cascadenorm.io.files import copied_names, is_url
from cascadenorm.io.sidecar_files import is_scene, missing
from cascadenorm.learned.methods import SHIPPED
from cascadenorm.registry import find
from cascadenorm.registry.controls import checked_controls
from cascadenorm.version import __version__

FULL = (errno.ENOSPC, errno.EDQUOT)
NO_RESULT = ("threads", "progress")  # controls that do not affect a result; they apply to the whole batch


@dataclass(frozen=True)
class BatchSettings:
    """Settings that apply to every file of a batch."""

    # method, parameters, controls, force: as in `denoise_file`
    method: str
    parameters: Mapping[str, Any]
    controls: Mapping[str, Any]
    force: bool
    key: str  # digest of everything that a result depends on, except the file


def batch_settings(
    method: str, parameters: Mapping[str, Any], controls: Mapping[str, Any], format: str | None, *, force: bool
) -> tuple[BatchSettings, int | None, Listener | None]:
    """Check the settings; return them, the number of threads and the listener. Raises ParameterError."""
    every, values = checked_controls(controls), find(method).with_defaults(parameters)
    given = {name: value for name, value in every.items() if name not in NO_RESULT}
    parts = [__version__, source_digest(find(method).function), method, values, given, format]
    parts = [json.dumps(parts, sort_keys=True, default=_as_text), *map(_content, given.values())]
    if method in SHIPPED:
        if not isinstance(model := values["model"], str | PathLike | None):
            raise ParameterError(
                f"is of type {type(model).__name__}; it must be the path of a weights file, which each process reads",
                parameter="model",
            )
        api.check_weights(method, values)  # fail early: invalid weights would fail for every file
        parts.append(api.weights_digest(method, values))
    key = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    return BatchSettings(method, dict(parameters), given, force, key), every["threads"], every["progress"]


def _as_text(value: Any) -> str:
    return hashlib.sha256(value.tobytes()).hexdigest() if isinstance(value, np.ndarray) else str(value)


def _content(value: Any) -> str:
    """Return the digest of the file that a control names, such as a mask; empty for other values."""
    named = isinstance(value, str | PathLike) and os.path.isfile(value)  # also of a list that is too long for a name
    return file_digest(Path(value)) if named else ""


class Task(NamedTuple):
    """A file to be checked or denoised."""

    job: Job
    line: Line | None  # last line of the file in the manifest
    checked: bool = False  # whether the check is done or unnecessary, so that the file is denoised next
    digest: str | None = None  # of the file, if the check has computed it
    scratch: str | None = None  # folder for temporary files; None uses that of the system


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Outcome of processing a file."""

    # "new" or "kept" after a check, where "kept" means already done; "done" or "failed" after denoising
    status: Literal["new", "kept", "done", "failed"]
    # input_digest, output_digest: digests of the source and the result, if known
    input_digest: str | None = None
    output_digest: str | None = None
    copies: Digests | None = None  # of referenced files, as they were copied; None if not known
    summary: DenoisingSummary | None = None
    error: Exception | None = None
    then: Literal["continue", "retry", "stop"] = "continue"  # after a failure; "stop" if the disk is full
    seconds: float = 0.0  # total time, including reading and writing


def work(settings: BatchSettings, task: Task) -> Outcome:
    """Check or denoise a file; errors are returned as outcomes."""
    start = time.perf_counter()
    try:
        return _denoised(settings, task, start) if task.checked else _checked(settings, task)
    except Exception as error:  # one bad file must not stop the others
        return Outcome(
            status="failed",
            input_digest=task.digest or _digest_after_failure(task.job.source),
            error=error,
            then=_after(error, task.job),
            seconds=time.perf_counter() - start,
        )


def _digest_after_failure(source: str) -> str | None:
    """Return the digest of a file that was not checked; None if it cannot be read or is at a URL."""
    with suppress(Exception):  # the error of the file has already been reported
        return None if is_url(source) else file_and_buffers_digest(Path(source))
    return None


def file_and_buffers_digest(path: Path) -> str:
    """Return the digest of a mesh file and of the external buffers of a glTF file.

    Raises ReadError if one of the files cannot be read.
    """
    try:
        if path.suffix.lower() != ".gltf":
            return file_digest(path)
        parts = [path.parent / name for name, needed in io.read(path).refers_to().items() if needed]
        return hashlib.sha256("".join(map(file_digest, [path, *parts])).encode()).hexdigest()
    except FileNotFoundError as error:
        raise ReadError(f"{path} does not exist: check the name") from error
    except OSError as error:
        raise ReadError(f"{path} cannot be read: {error.strerror or error}") from error


def _checked(settings: BatchSettings, task: Task) -> Outcome:
    """Test whether the manifest records the same work for this file and the result still exists."""
    job, line = task.job, task.line
    same = line is not None and line["status"] == "done" and line["settings"] == settings.key
    digest = _digest(job.source, task) if same or not is_url(job.source) else None  # no needless download
    _check_target(settings, task)  # before the `started` line, which marks an existing file as ours
    if line is None:
        return Outcome(status="new", input_digest=digest)
    copies: Digests = line.get("copies") or {}
    unchanged = same and line["input_sha256"] == digest and are_current(copies, Path(job.source), Path(job.output))
    if unchanged and _exists(job.output) and _digest(job.output, task) == line["output_sha256"]:
        return Outcome(status="kept", input_digest=digest)
    if not settings.force and _is_local(job):
        check_copies(copies, Path(job.source), Path(job.output))
    return Outcome(status="new", input_digest=digest)


def _is_local(job: Job) -> bool:
    """Test that a file and its result are on this machine, so that the files it refers to are copied."""
    return not is_url(job.source) and not is_url(job.output)


def _denoised(settings: BatchSettings, task: Task, start: float) -> Outcome:
    job = task.job
    with _here(task) as (source, output):
        digest = task.digest or file_and_buffers_digest(source)
        make_folder(output.parent)
        try:
            denoised = api.denoise_file_with_meshes(
                source,
                output,
                method=settings.method,
                parameters=dict(settings.parameters),
                force=settings.force or is_url(job.output) or _may_replace(task),
                **settings.controls,
            )
        except CascadenormError as error:
            if error.place != str(source):
                raise
            raise error.within(job.source) from error.__cause__
        if file_and_buffers_digest(source) != digest:
            output.unlink(missing_ok=True)
            raise ChangedError(f"{job.source} changed while it was read", hint="try again when it is complete")
        written = file_and_buffers_digest(output)
        copies = copies_beside(copied_names(denoised.after, output), source, output)
        summary = denoised.summary
        left_out = summary.left_out
        if is_url(job.output):
            _check_target(settings, task)
            upload(output, job.output)
            left_out += tuple(missing(name) for name, copy in copies.items() if copy is not None)
    return Outcome(
        status="done",
        input_digest=digest,
        output_digest=written,
        copies=copies if _is_local(job) else {},
        summary=replace(summary, source=job.source, output=job.output, left_out=left_out),
        seconds=time.perf_counter() - start,
    )


@contextmanager
def _here(task: Task) -> Iterator[tuple[Path, Path]]:
    """Provide local paths of a file and its result; copies of remote files exist only within the context."""
    source, output = task.job.source, task.job.output
    if _is_local(task.job):
        yield Path(source), Path(output)
        return
    with TemporaryDirectory(prefix="cascadenorm-", dir=task.scratch) as scratch:
        copy = _fetched(source, Path(scratch, "in")) if is_url(source) else Path(source)
        yield copy, Path(scratch, "out", file_name(output)) if is_url(output) else Path(output)


def _fetched(url: str, folder: Path) -> Path:
    if file_name(url).lower().endswith(".gltf"):
        raise ReadError(f"{url} has its buffers in other files, which are read from folders only", hint="use .glb")
    return fetched(url, folder)


def _digest(name: str, task: Task) -> str:
    """Return the digest of a mesh file, after downloading it if it is at a URL."""
    if is_url(name):
        with TemporaryDirectory(prefix="cascadenorm-", dir=task.scratch) as scratch:
            return file_and_buffers_digest(_fetched(name, Path(scratch)))
    return file_and_buffers_digest(Path(name))


def _exists(name: str) -> bool:
    return exists(name) if is_url(name) else os.path.isfile(name)


def _check_target(settings: BatchSettings, task: Task) -> None:
    """Raise OutputError if the output exists and was not written by a batch, or is a link to the source."""
    output = task.job.output
    if is_url(output):
        if exists(output) and not settings.force and not _is_ours(task):
            raise OutputError(f"{output} exists already", hint="choose another name", remedy=("force", True))
    elif os.path.exists(output):
        if os.path.realpath(output) == os.path.realpath(task.job.source):
            raise OutputError(f"{output} is a link to {task.job.source}", hint="remove it, or choose another folder")
        check_output(Path(output), force=settings.force or _is_ours(task))


def _may_replace(task: Task) -> bool:
    """Test whether the result and the files beside it may be replaced, after their check.

    If a missing result was never complete, the files may belong to another result, such as a buffer that both use.
    """
    deleted = task.line is not None and task.line["output_sha256"] is not None and not _exists(task.job.output)
    return deleted or _is_ours(task)


def _is_ours(task: Task) -> bool:
    """Test whether an existing file is a result of the batch, which may be replaced.

    This includes results that a stopped process may have written at the last moment, and copies of the source beside
    results that refer to it.
    """
    line, output = task.line, task.job.output
    if not _exists(output):
        return False
    if _is_local(task.job) and is_scene(output) and _digest(output, task) == _digest(task.job.source, task):
        return True
    if line is None:
        return False
    stopped = line["status"] == "failed" and line["error"]["type"] == WorkerError.__name__
    return stopped or bool(line["status"] == "started") or _digest(output, task) == line["output_sha256"]


def _after(error: Exception, job: Job) -> Literal["continue", "retry", "stop"]:
    """Decide what to do after a failure; a file that existed when it was listed may reappear with its network share."""
    cause = error.__cause__ or error
    if isinstance(cause, OSError) and cause.errno in FULL:
        return "stop"
    temporary = isinstance(error, MemoryError | ChangedError) or (isinstance(cause, OSError) and cause is not error)
    # a copy that belongs to several meshes is outdated until the first of them is denoised again, and another file may
    # have put a copy where the result belongs
    shared = isinstance(error, OutputError) and error.remedy == ("force", True)
    lasting = isinstance(cause, PermissionError) or (isinstance(cause, FileNotFoundError) and job.changed is None)
    return "retry" if (temporary or shared) and not lasting else "continue"
