"""Where the work on files is done: the interface that a batch sees, and processes of this machine."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

from cascadenorm.batch.inputs import Job
from cascadenorm.batch.scheduling import Place
from cascadenorm.batch.work import Outcome, Task
from cascadenorm.errors import WorkerError
from cascadenorm.execution.worker_processes import Worker, do_jobs, first_ready

Work = Callable[[Task], Outcome]
FileWorker = Worker[tuple[Task, int], Outcome]
"""It is sent tasks with their numbers of threads."""


class Processes(Protocol):
    """Processes that do the work on files, each on one file at a time."""

    @property
    def places(self) -> Sequence[Place]:
        """Where work can be begun; a cluster may gain and lose places."""

    def begin(self, place: Place, task: Task, threads: int) -> None:
        """Begin the work on a file, in a process of the place that works on no other."""

    def ended(self, seconds: float | None) -> list[tuple[Job, Outcome | WorkerError]]:
        """Wait for outcomes, or for so many seconds; a WorkerError where the process has ended before its work."""

    def stop(self, job: Job) -> None:
        """End the process that works on a file, with its work."""

    def close(self) -> None:
        """End all."""


class LocalProcesses:
    """Processes of this machine.

    Parameters
    ----------
    work
        What they do.
    place
        Cores and memory that they share.
    """

    def __init__(self, work: Work, place: Place) -> None:
        self._serve = partial(do_jobs, work=work)
        self.places = [place]
        self._idle: list[FileWorker] = []
        self._busy: dict[Job, FileWorker] = {}

    def begin(self, place: Place, task: Task, threads: int) -> None:
        """Begin the work on a file; the process that was idle last has it warmest in memory."""
        self._busy[task.job] = self._idle.pop() if self._idle else Worker(self._serve)
        self._busy[task.job].send((task, threads))

    def ended(self, seconds: float | None) -> list[tuple[Job, Outcome | WorkerError]]:
        """Wait for outcomes, or for so many seconds."""
        if not self._busy:
            time.sleep(seconds or 0.0)
            return []
        jobs = {worker: job for job, worker in self._busy.items()}
        found: list[tuple[Job, Outcome | WorkerError]] = []
        for worker in first_ready(list(jobs), seconds):
            job = jobs[worker]
            try:
                found.append((job, worker.receive()))
                self._idle.append(worker)
                del self._busy[job]
            except WorkerError as error:
                found.append((job, error))
                self.stop(job)
        return found

    def stop(self, job: Job) -> None:
        """End the process that works on a file."""
        Worker.stop([self._busy.pop(job)])

    def close(self) -> None:
        """End all processes."""
        Worker.stop([*self._idle, *self._busy.values()])
        self._idle, self._busy = [], {}
