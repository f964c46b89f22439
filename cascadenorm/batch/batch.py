"""Many files denoised in worker processes, so that no failure stops the others; interrupted batches resume."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from datetime import datetime, timezone
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from cascadenorm.api import DEFAULT_METHOD
from cascadenorm.batch.inputs import Job, Sources, check_sources, find_jobs
from cascadenorm.batch.manifest import Line, Manifest
from cascadenorm.batch.scheduling import Schedule
from cascadenorm.batch.settings import settings_of
from cascadenorm.batch.watching import Settled
from cascadenorm.batch.work import Outcome, Settings, Task, work
from cascadenorm.controls.settings import Controls, takes_controls
from cascadenorm.errors import OutputError, ParameterError, WorkerError
from cascadenorm.io.atomic import remove_unfinished
from cascadenorm.memory import available_memory, memory_size
from cascadenorm.mesh import thread_count
from cascadenorm.progress import Listener
from cascadenorm.worker_processes import Worker, first_ready

if TYPE_CHECKING:
    from typing_extensions import Unpack

SCAN = 0.5
"""Least number of seconds between two scans of a watched folder."""

SCANNING = 20
"""The next scan waits this many times as long as the last one took, so that scans take at most 5 % of the time."""

FREE = 0.8
"""Fraction of the free memory that a batch uses by default."""

COST = 20_000
"""Fixed cost of a file in the progress, as the bytes that take the same time."""


class Failure(NamedTuple):
    """A file that could not be denoised."""

    source: str
    error: Exception


class Batch(NamedTuple):
    """What became of the files of a batch.

    Parameters
    ----------
    lines : of the manifest, for each file that was denoised now or failed, as they ended
    kept : names of the files that were done already
    failures : errors of those that failed
    """

    lines: list[Line]
    kept: list[str]
    failures: list[Failure]


@takes_controls
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
    watch: float | None = None,
    on_failure: Callable[[Failure], object] | None = None,
    **controls: Unpack[Controls],
) -> Batch:
    """Denoise many files into a folder, each as by `denoise_file`; a failure does not stop the others.

    Parameters
    ----------
    sources : files, folders or patterns such as "scans/**/*.ply", one or several
    output : folder of the results, which lie in it as the sources lie in the folder that they have in common. Its
        `manifest.jsonl` records what became of each file: what is done, by the digests of file, settings and result,
        is not done again
    method, parameters : as in `denoise_file`
    format : of the results, such as "stl"; None keeps that of each source
    force : replace files in the output folder that no batch has written
    workers : processes at most; None is one for each thread
    memory : of all processes together, as bytes or as text like "4GB"; None is most of what is free. Files are
        denoised side by side as far as their estimated needs fit
    retries : further attempts, alone, for a file whose process ended early, for which memory did not suffice, or that
        changed while it was read
    watch : go on and look for further files until interrupted; a file is taken once it has not changed for so many
        seconds
    on_failure : called with each failure as it happens

    `threads` counts those of all processes.

    Returns
    -------
    What became of each file

    Raises
    ------
    ReadError : there is no file
    ParameterError : an unknown method, parameter or control, a value out of range
    OutputError : the folder cannot be written, the disk is full, another batch is writing there, or two files have the
        same output path
    """
    for name, value, least in (("retries", retries, 0), ("workers", workers, 1), ("watch", watch, 0)):
        if value is not None and not value >= least:
            raise ParameterError(f"is {value}; it must be at least {least}", parameter=name)
    settings, threads, listener = settings_of(method, parameters or {}, controls, format, force=force)
    cores = threads or thread_count()
    budget = int(FREE * available_memory()) if memory is None else memory_size("memory", memory)
    folder = Path(output)
    find = partial(find_jobs, sources, folder, format)
    jobs = find()
    if watch is None:
        check_sources(sources, folder, jobs)
    manifest = Manifest(folder)
    try:
        run = _Run(settings, folder, manifest, Schedule(cores, budget), workers or cores, retries, listener, on_failure)
        run.all(jobs if watch is None else [], find, None if watch is None else Settled(watch))
    finally:
        manifest.close()
    return run.done


class _Run:
    """A batch while it runs: the processes, and what each is working on."""

    def __init__(
        self,
        settings: Settings,
        folder: Path,
        manifest: Manifest,
        schedule: Schedule,
        workers: int,
        retries: int,
        listener: Listener | None,
        on_failure: Callable[[Failure], object] | None,
    ) -> None:
        self._work = partial(work, settings)
        self._key = settings.key
        self._folder, self._manifest, self._schedule = folder, manifest, schedule
        self._count, self._retries, self._listener, self._on_failure = workers, retries, listener, on_failure
        self._idle: list[Worker[Task, Outcome]] = []
        self._busy: dict[Worker[Task, Outcome], tuple[Task, int]] = {}
        self._attempts: dict[Job, int] = {}
        self._found = self._ended = 0
        self.done = Batch([], [], [])

    def all(self, jobs: list[Job], find: Callable[[], list[Job]], settled: Settled | None) -> None:
        """Denoise the files, and those that settle later; no process or partial file is left, even after an error."""
        remove_unfinished([Path(job.output) for job in jobs])
        self._add(jobs)
        scan = 0.0  # when to look for further files
        try:
            while self._schedule.left or settled is not None:
                self._begin_all()
                if self._busy:
                    for worker in first_ready(list(self._busy), None if settled is None else SCAN):
                        self._end(worker)
                elif settled is not None:
                    time.sleep(SCAN)
                if settled is not None and (begin := time.monotonic()) >= scan:
                    busy = {job.source for job in self._attempts}
                    self._add(settled.take([job for job in find() if job.source not in busy]))
                    end = time.monotonic()
                    scan = end + max(SCAN, SCANNING * (end - begin))
        finally:
            unfinished = [Path(task.job.output) for task, _ in self._busy.values()]
            Worker.stop([*self._idle, *self._busy])
            remove_unfinished(unfinished)

    def _add(self, jobs: list[Job]) -> None:
        self._schedule.add(jobs)
        self._attempts.update(dict.fromkeys(jobs, 0))
        self._found += sum(job.size + COST for job in jobs)

    def _begin_all(self) -> None:
        """Begin as many files as processes, cores and memory allow."""
        while len(self._busy) < self._count and (following := self._schedule.next()) is not None:
            job, threads = following
            self._attempts[job] += 1
            worker = self._idle.pop() if self._idle else Worker(self._work)
            self._begin(worker, Task(job, self._manifest.last.get(self._name(job))), threads)

    def _begin(self, worker: Worker[Task, Outcome], task: Task, threads: int) -> None:
        self._busy[worker] = task, threads
        worker.begin(task, threads)

    def _end(self, worker: Worker[Task, Outcome]) -> None:
        """Handle the outcome of a process; a checked file goes on to be denoised by the same process."""
        task, threads = self._busy[worker]
        try:
            outcome = worker.result()
            del self._busy[worker]
            self._idle.append(worker)
        except WorkerError as error:
            del self._busy[worker]
            remove_unfinished([Path(task.job.output)])
            outcome = Outcome(status="failed", input_digest=task.digest, error=error, then="again")
        if outcome.status == "new":
            self._idle.remove(worker)
            task = task._replace(digest=outcome.input_digest)
            self._manifest.add(self._line("started", task, outcome))
            self._begin(worker, task, threads)
            return
        self._schedule.end(task.job)
        if outcome.then == "again" and self._attempts[task.job] <= self._retries:
            self._schedule.again(task.job)
            return
        self._record(task, outcome)

    def _record(self, task: Task, outcome: Outcome) -> None:
        """Record the outcome of a file in the manifest and the result."""
        if outcome.status == "kept":
            self.done.kept.append(task.job.source)
        else:
            line = self._line(outcome.status, task, outcome)
            self._manifest.add(line)
            self.done.lines.append(line)
        if outcome.error is not None:
            self.done.failures.append(Failure(task.job.source, outcome.error))
            if self._on_failure is not None:
                self._on_failure(self.done.failures[-1])
            if outcome.then == "stop":
                raise OutputError(
                    "the disk is full",
                    hint="free some space and run the same command again: files that are done are kept",
                )
        del self._attempts[task.job]
        self._ended += task.job.size + COST
        if self._listener is not None:
            self._listener(self._ended / self._found)

    def _name(self, job: Job) -> str:
        """The name of a result in the manifest, from the folder of the manifest."""
        return Path(job.output).relative_to(self._folder).as_posix()

    def _line(self, status: str, task: Task, outcome: Outcome) -> Line:
        previous = self._manifest.last.get(self._name(task.job)) or {}
        summary = None if outcome.summary is None else asdict(outcome.summary)
        error = outcome.error
        return {
            "status": status,
            "input": task.job.source,
            "input_sha256": outcome.input_digest,
            "output": self._name(task.job),
            "output_sha256": outcome.output_digest or previous.get("output_sha256"),
            "settings": self._key,
            "attempts": self._attempts[task.job],
            "seconds": outcome.seconds,
            "time": datetime.now(timezone.utc).isoformat(timespec="milliseconds"),
            "summary": summary,
            "error": None if error is None else {"type": type(error).__name__, "message": str(error)},
        }
