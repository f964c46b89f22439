"""Local processes of a batch. Those of a cluster have the same methods."""

import time
from collections.abc import Callable
from functools import partial

from cascadenorm.batch.inputs import Job
from cascadenorm.batch.scheduling import Place
from cascadenorm.batch.work import Outcome, Task
from cascadenorm.errors import WorkerError
from cascadenorm.execution.worker_processes import Worker, do_jobs, first_ready

Work = Callable[[Task], Outcome]
FileWorker = Worker[tuple[Task, int], Outcome]  # a worker process that receives tasks with their numbers of threads


class LocalProcesses:
    """Worker processes on this machine, each for one file, which share the cores and the memory of a place."""

    def __init__(self, work: Work, place: Place) -> None:
        self._serve = partial(do_jobs, work=work)
        self.places = [place]
        self._idle: list[FileWorker] = []
        self._busy: dict[Job, FileWorker] = {}

    def begin(self, place: Place, task: Task, threads: int) -> None:
        """Start processing a file, preferably in the most recently used process, whose caches are warm."""
        self._busy[task.job] = self._idle.pop() if self._idle else Worker(self._serve)
        self._busy[task.job].send((task, threads))

    def ended(self, seconds: float) -> list[tuple[Job, Outcome | WorkerError]]:
        """Wait for outcomes, at most this many seconds; a process that died early yields a WorkerError."""
        if not self._busy:
            time.sleep(seconds)
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
        """Stop the process that works on a file."""
        Worker.stop([self._busy.pop(job)])

    def close(self) -> None:
        """Stop all processes."""
        Worker.stop([*self._idle, *self._busy.values()])
        self._idle, self._busy = [], {}
