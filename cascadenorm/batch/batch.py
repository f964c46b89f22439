"""Denoise many files in worker processes and resume interrupted batches; a failure does not stop the others."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from cascadenorm.api.api import DEFAULT_METHOD
from cascadenorm.batch.inputs import Job, Sources, check_sources, find_jobs, source_names
from cascadenorm.batch.manifest import MANIFEST_NAME, Line, Manifest
from cascadenorm.batch.processes import LocalProcesses
from cascadenorm.batch.remote_files import check_writable
from cascadenorm.batch.scheduling import Place, Schedule
from cascadenorm.batch.watching import SCAN, Watched
from cascadenorm.batch.work import BatchSettings, Outcome, Task, batch_settings, work
from cascadenorm.errors import OutputError, ParameterError, WorkerError
from cascadenorm.execution.cluster import required_folder
from cascadenorm.execution.memory import USABLE_FRACTION, available_memory, parse_bytes
from cascadenorm.execution.progress import Listener
from cascadenorm.io import output_format
from cascadenorm.io.atomic import remove_unfinished
from cascadenorm.io.files import is_url
from cascadenorm.mesh import thread_count
from cascadenorm.registry import checked_number
from cascadenorm.registry.controls import Controls, with_control_parameters

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from cascadenorm.batch.cluster_processes import ClusterProcesses

LONGEST_WAIT_S = 3600.0  # maximum number of seconds of one wait, because the system cannot wait for months

COST = 20_000  # fixed cost of a file in the progress, expressed as an equivalent number of bytes


class Failure(NamedTuple):
    """A file that could not be denoised."""

    source: str
    error: Exception


class Batch(NamedTuple):
    """Outcome of the files of a batch."""

    # manifest lines of the files that were denoised or failed in this run, in the order in which they ended
    lines: list[Line]
    kept: list[str]  # names of the files that were already done
    failures: list[Failure]  # errors of the files that failed
    skipped: list[str]  # names of files that were not read because `denoise` wrote them beside their sources


@with_control_parameters
def denoise_files(
    sources: Sources,
    output: str | PathLike[str],
    *,
    method: str = DEFAULT_METHOD,
    format: str | None = None,
    force: bool = False,
    parameters: dict[str, Any] | None = None,
    workers: int | None = None,
    memory: str | int | None = None,
    retries: int = 1,
    timeout: float | None = None,
    watch: float | None = None,
    scheduler: str | None = None,
    manifest: str | PathLike[str] | None = None,
    on_failure: Callable[[Failure], object] | None = None,
    **controls: Unpack[Controls],
) -> Batch:
    """Denoise many files into a folder, each as by `denoise_file`; a failure does not stop the others.

    In a script, call this function below `if __name__ == "__main__":`, because worker processes import the script.

    Parameters
    ----------
    sources
        One or several files, folders or patterns such as "scans/**/*.ply", or URLs of these.
    output
        Folder for the results, or its URL in an object store. Results keep the folder structure that the sources have
        below their common folder.
    method, parameters
        As in `denoise_file`.
    format
        Format of the results, such as "stl". None keeps the format of each source.
    force
        Replace files in the output folder that were not written by a batch.
    workers
        Maximum number of processes. None starts one per thread.
    memory
        Memory limit for all processes together, as bytes or as text like "4GB". None uses most of the free memory.
        Files are processed in parallel as long as their estimated needs fit.
    retries
        Further attempts for a file whose process died or was stopped, that ran out of memory, or that changed while it
        was read. The file then runs alone.
    timeout
        Seconds after which the process that works on a file is stopped. None sets no limit.
    watch
        Keep looking for further files until interrupted. A file is processed once it has not changed for this many
        seconds.
    scheduler
        Address of the scheduler of a Dask cluster whose workers can access the same files; "local" starts a cluster on
        this machine; None starts processes. Workers of a cluster have their own limits: `memory` and `threads` apply to
        this machine only.
    manifest
        File that records the outcome of each file. Files whose digests of input, settings and result match a record
        are not processed again. None uses `manifest.jsonl` in the output folder; if that is a URL, a name is required.
    on_failure
        Called with each failure as it happens. With `watch`, also called if the sources cannot be listed, which does
        not end the watch, and for files whose results would replace those of others.

    `threads` is the total for all processes.

    Returns
    -------
    The outcome of each file

    Raises
    ------
    ReadError
        No file was found.
    ParameterError
        A method, parameter or control is unknown, or a value is out of range.
    OutputError
        The folder cannot be written, the disk is full, another batch is writing to it, or two files have the same
        output path.
    WorkerError
        The scheduler or the workers of a cluster are unreachable or cannot do the work.
    """
    workers = checked_number("workers", int | None, workers, minimum=1)
    retries = checked_number("retries", int, retries, minimum=0)
    timeout = checked_number("timeout", float | None, timeout, above=0)
    watch = checked_number("watch", float | None, watch, minimum=0)
    format = None if format is None else output_format(f".{format}")  # ".STL" is "stl"
    settings, threads, listener = batch_settings(method, parameters or {}, controls, format, force=force)
    here = _this_machine(workers, threads, memory, scheduler)
    folder: str | Path = str(output).rstrip("/") if is_url(output) else Path(output)
    record = _manifest_path(folder, manifest)
    sources, skipped = source_names(sources), list[str]()
    jobs = find_jobs(sources, folder, format, skipped=skipped)
    if watch is None:
        check_sources(sources, folder, jobs)
    processes = _started(settings, here, workers, scheduler, [*sources, output])
    with closing(processes), closing(Manifest(record)) as lines:
        run = _Run(settings.key, folder, lines, processes, retries, timeout, listener, on_failure)
        if watch is None:
            run.all(jobs)
        else:
            names, find = ", ".join(sources), partial(find_jobs, sources, folder, format)
            run.all([], Watched(find, watch, lambda error: run.tell(Failure(names, error))))
    return run.done._replace(skipped=skipped)


def _started(
    settings: BatchSettings, here: Place, workers: int | None, scheduler: str | None, names: list[str | PathLike[str]]
) -> LocalProcesses | ClusterProcesses:
    """Start processes on this machine, or connect to those of a cluster, which can find the files of these names."""
    if scheduler is None:
        return LocalProcesses(partial(work, settings), here)
    from cascadenorm.batch.cluster_processes import ClusterProcesses  # needs distributed

    values = [*settings.parameters.values(), *settings.controls.values()]
    folder = required_folder([name for name in names if not is_url(name)], values)
    return ClusterProcesses(partial(work, settings), scheduler, here, count=workers, folder=folder)


def _manifest_path(folder: str | Path, given: str | PathLike[str] | None) -> Path:
    """Return the path of the manifest, a local file."""
    if isinstance(folder, str):
        check_writable(folder)
    if given is not None:
        return Path(given)
    if isinstance(folder, Path):
        return folder / MANIFEST_NAME
    raise ParameterError(
        f"is not given, and {folder} is a URL: name a file of this machine that records what is done",
        parameter="manifest",
    )


def _this_machine(workers: int | None, threads: int | None, memory: str | int | None, scheduler: str | None) -> Place:
    """Return the resources that the processes of this machine share."""
    given = {"threads": threads, "memory": memory}
    for name in given if scheduler not in (None, "local") else ():
        if given[name] is not None:
            raise ParameterError("is for this machine: workers of a cluster have limits of their own", parameter=name)
    cores = threads or thread_count()
    budget = int(USABLE_FRACTION * available_memory()) if memory is None else parse_bytes(memory)
    return Place(cores, budget, workers or cores)


@dataclass(frozen=True)
class _Begun:
    """A file in progress, with its place, number of threads and deadline."""

    task: Task
    place: Place
    threads: int
    end: float


def _remove_unfinished(jobs: list[Job]) -> None:
    with suppress(OSError):  # a network share may be gone; the next batch removes them
        remove_unfinished([Path(job.output) for job in jobs if not is_url(job.output)])


@dataclass
class _Run:
    """The state of a running batch."""

    key: str  # of the settings
    folder: str | Path
    manifest: Manifest
    processes: LocalProcesses | ClusterProcesses
    retries: int
    timeout: float | None
    listener: Listener | None
    on_failure: Callable[[Failure], object] | None
    schedule: Schedule = field(default_factory=Schedule)
    busy: dict[Job, _Begun] = field(default_factory=dict)
    attempts: dict[Job, int] = field(default_factory=dict)
    found: int = 0  # bytes, with COST for each file
    ended: int = 0  # such bytes of the files that ended
    done: Batch = field(default_factory=lambda: Batch([], [], [], []))

    def all(self, jobs: list[Job], watched: Watched | None = None) -> None:
        """Denoise all files, including those that settle later; clean up processes and partial files even on error."""
        try:
            _remove_unfinished(jobs)
            self._add(jobs)
            while self.schedule.left or watched is not None:
                self._begin_all()
                for job, outcome in self.processes.ended(self._patience(LONGEST_WAIT_S if watched is None else SCAN)):
                    self._end(job, outcome)
                self._stop_late()
                if watched is not None:
                    self._add(watched.take({job.source for job in self.attempts}))
        finally:
            self.processes.close()
            _remove_unfinished(list(self.busy))

    def tell(self, failure: Failure) -> None:
        """Report a failure to the caller as it happens."""
        if self.on_failure is not None:
            self.on_failure(failure)

    def _add(self, jobs: list[Job]) -> None:
        self.schedule.add(jobs)
        self.attempts.update(dict.fromkeys(jobs, 0))
        self.found += sum(job.size + COST for job in jobs)

    def _begin_all(self) -> None:
        """Start as many files as processes, cores and memory allow."""
        while (following := self.schedule.next(self.processes.places)) is not None:
            place, job, threads = following
            self.attempts[job] += 1
            task = Task(job, self.manifest.last.get(self._name(job)))
            if task.line is None and not is_url(job.output) and not os.path.lexists(job.output):
                self._start(place, task, threads)  # nothing to check
            else:
                self._begin(place, task, threads)

    def _start(self, place: Place, task: Task, threads: int, digest: str | None = None) -> None:
        """Start denoising a file; the digest comes from its check."""
        self.manifest.add(self._line("started", task, Outcome(status="new", input_digest=digest)))
        self._begin(place, task._replace(checked=True, digest=digest), threads)

    def _begin(self, place: Place, task: Task, threads: int) -> None:
        end = math.inf if self.timeout is None else time.monotonic() + self.timeout
        self.busy[task.job] = _Begun(task, place, threads, end)
        self.processes.begin(place, task, threads)

    def _patience(self, seconds: float) -> float:
        """Return how long to wait for outcomes: the given seconds, or less if a file reaches its timeout earlier."""
        left = min((begun.end for begun in self.busy.values()), default=math.inf) - time.monotonic()
        return min(seconds, max(0.0, left))

    def _stop_late(self) -> None:
        """Stop the processes that exceeded the timeout."""
        now = time.monotonic()
        for job in [job for job, begun in self.busy.items() if begun.end <= now]:
            self.processes.stop(job)
            self._end(job, WorkerError(f"it took longer than {self.timeout:g} seconds, and was stopped"))

    def _end(self, job: Job, outcome: Outcome | WorkerError) -> None:
        """Handle the outcome of a process; after a check, denoise the file in the same place."""
        begun = self.busy.pop(job)
        task = begun.task
        if isinstance(outcome, WorkerError):
            _remove_unfinished([job])
            outcome = Outcome(status="failed", input_digest=task.digest, error=outcome, then="retry")
        if outcome.status == "new":
            self._start(begun.place, task, begun.threads, outcome.input_digest)
            return
        self.schedule.end(job)
        if outcome.then == "retry" and self.attempts[job] <= self.retries:
            self.schedule.retry(job)
            return
        self._record(task, outcome)

    def _record(self, task: Task, outcome: Outcome) -> None:
        """Record the outcome of a file in the manifest and in the result."""
        if outcome.status == "kept":
            self.done.kept.append(task.job.source)
        else:
            line = self._line(outcome.status, task, outcome)
            self.manifest.add(line)
            self.done.lines.append(line)
        if outcome.error is not None:
            self.done.failures.append(Failure(task.job.source, outcome.error))
            self.tell(self.done.failures[-1])
            if outcome.then == "stop":
                raise OutputError(
                    "the disk is full",
                    hint="free some space and run the same command again: files that are done are kept",
                )
        del self.attempts[task.job]
        self.ended += task.job.size + COST
        if self.listener is not None:
            self.listener(self.ended / self.found)

    def _name(self, job: Job) -> str:
        """Return the name of a result in the manifest, relative to the output folder."""
        if isinstance(self.folder, str):
            return job.output.removeprefix(f"{self.folder}/")
        return Path(job.output).relative_to(self.folder).as_posix()

    def _line(self, status: str, task: Task, outcome: Outcome) -> Line:
        previous = self.manifest.last.get(self._name(task.job)) or {}
        summary = None if outcome.summary is None else asdict(outcome.summary)
        error = outcome.error
        return {
            "status": status,
            "input": task.job.source,
            "input_sha256": outcome.input_digest,
            "output": self._name(task.job),
            "output_sha256": outcome.output_digest or previous.get("output_sha256"),
            "copies": previous.get("copies") or {} if outcome.copies is None else outcome.copies,
            "settings": self.key,
            "attempts": self.attempts[task.job],
            "seconds": outcome.seconds,
            "time": datetime.now(timezone.utc).isoformat(timespec="milliseconds"),
            "summary": summary,
            "error": None if error is None else {"type": type(error).__name__, "message": str(error)},
        }
