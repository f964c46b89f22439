"""Process files on the workers of a Dask cluster.

Each worker processes one file at a time with all its threads. Dask only transfers the work; the batch decides which
file is next and what is retried. This prevents Dask from silently restarting the tasks of a lost worker.
"""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from cascadenorm.batch.inputs import Job
from cascadenorm.batch.processes import Work
from cascadenorm.batch.scheduling import Place
from cascadenorm.batch.work import Outcome, Task
from cascadenorm.errors import WorkerError
from cascadenorm.execution.cluster import (
    POLL_INTERVAL_S,
    REPLY_TIMEOUT_S,
    WORKER_TIMEOUT_S,
    dask_client,
    dask_message,
    lost_scheduler,
    mismatch,
    no_workers,
)
from cascadenorm.execution.memory import available_memory
from cascadenorm.mesh import limit_threads
from cascadenorm.version import __version__

if TYPE_CHECKING:
    from distributed import Client, Future

MEMORY = 0.8
"""Fraction of a worker's memory that files may need. Dask pauses a worker above it and terminates it at 95 %."""

TOKEN = secrets.token_hex(8)  # identifies this process, as opposed to a later one at the same address


@dataclass(eq=False)
class Member(Place):
    """A worker of the cluster, as a place with one process, with its version and current folder."""

    address: str = ""
    process: str = ""
    version: str = ""
    folder: str = ""


def about(address: str) -> Member:
    """Describe the worker that runs this function, at an address."""
    from distributed import get_worker

    worker = get_worker()
    limit = worker.memory_manager.memory_limit or available_memory()
    threads, memory = worker.state.nthreads, int(MEMORY * limit)
    return Member(threads, memory, 1, address=address, process=TOKEN, version=__version__, folder=os.getcwd())


def do(process: str, work: Work, task: Task, threads: int) -> Outcome:
    """Do the work, unless the worker process was restarted."""
    from distributed import get_worker

    if process != TOKEN:
        raise WorkerError("the worker was restarted before it had done the work")
    with limit_threads(threads), threadpool_limits(threads):
        return work(task._replace(scratch=get_worker().local_directory))  # Dask empties it if a worker dies


class ClusterProcesses:
    """The available workers of a cluster; workers may join and leave.

    The scheduler is an address, or "local" for a cluster that divides the resources `here` among its workers. At most
    `count` workers are used; None uses all. They must run in `folder` because file names are relative; None accepts any
    folder. Raises MissingDependencyError or ParameterError as `dask_client` does.
    """

    def __init__(self, work: Work, scheduler: str, here: Place, *, count: int | None, folder: str | None) -> None:
        self._work, self._scheduler, self._count, self._folder = work, scheduler, count, folder
        self._stack = ExitStack()
        threads, memory = max(1, here.cores // here.processes), int(here.memory / here.processes / MEMORY)
        connection = dask_client(scheduler, workers=here.processes, threads=threads, memory=memory)
        self._client: Client = self._stack.enter_context(connection)
        self._asked: dict[str, Future[Member]] = {}
        self._members: dict[str, Member] = {}
        self._refused: dict[str, str] = {}
        self._unresponsive: set[str] = set()
        self._busy: dict[Job, tuple[Member, Future[Outcome]]] = {}
        self._ready: SimpleQueue[tuple[Job, Future[Outcome]]] = SimpleQueue()
        self._looked, self._in_use = -POLL_INTERVAL_S, time.monotonic()

    @property
    def places(self) -> Sequence[Place]:
        """Workers that are available now."""
        return list(self._members.values())[: self._count]

    def begin(self, place: Place, task: Task, threads: int) -> None:
        assert isinstance(place, Member)
        future = self._submit(place.address, do, place.process, self._work, task, threads)
        self._busy[task.job] = place, future
        future.add_done_callback(lambda _: self._ready.put((task.job, future)))

    def ended(self, seconds: float) -> list[tuple[Job, Outcome | WorkerError]]:
        """Wait for outcomes, at most until the next check of the workers. Raises WorkerError if all are unreachable."""
        found: list[tuple[Job, Outcome | WorkerError]] = []
        wait = min(seconds, POLL_INTERVAL_S)
        with suppress(Empty):
            while True:
                job, future = self._ready.get(timeout=0.0 if found else wait)
                if job in self._busy and self._busy[job][1] is future:  # else an earlier attempt that was abandoned
                    found.append((job, self._outcome(*self._busy.pop(job))))
        if time.monotonic() >= self._looked + POLL_INTERVAL_S:
            found += self._look()
            self._looked = time.monotonic()
        return found

    def stop(self, job: Job) -> None:
        """Let the nanny of a worker restart the process of a file; without a nanny, the worker is not reused."""
        member, future = self._busy.pop(job)
        future.release()
        self._members.pop(member.address, None)
        self._unresponsive.add(member.process)
        Thread(target=self._restart, args=(member.address,), daemon=True).start()

    def close(self) -> None:
        """Disconnect from the cluster, which drops tasks not yet started; a local cluster is shut down."""
        self._busy = {}
        self._stack.close()

    def _submit(self, address: str, function: Any, *values: Any) -> Future[Any]:
        try:
            return self._client.submit(function, *values, workers=[address], allow_other_workers=False, pure=False)
        except Exception as error:  # connection errors
            raise self._without_scheduler(error) from None

    def _without_scheduler(self, error: Exception) -> WorkerError:
        return lost_scheduler(self._scheduler, error, "run the same again: what is done is kept")

    def _outcome(self, member: Member, future: Future[Outcome]) -> Outcome | WorkerError:
        """Return the outcome of finished work, which is stored on the worker."""
        try:
            return self._received(member.address, future)
        except Exception as error:  # any error that Dask raises if a worker or its answer is lost
            self._members.pop(member.address, None)  # another process may now use its address
            return WorkerError(f"the worker {member.address} did not do the work: {dask_message(error)}")

    def _received(self, address: str, future: Future[Outcome]) -> Outcome:
        """Wait for the outcome as long as its worker is there, since Dask would wait for a lost worker to return."""
        from distributed import TimeoutError as Late

        late = time.monotonic() + REPLY_TIMEOUT_S
        while True:
            try:
                found: Outcome = future.result(timeout=POLL_INTERVAL_S)
                return found
            except Late:
                if address not in self._client.nthreads():
                    raise WorkerError("it has left the cluster before it gave its result") from None
                if time.monotonic() > late:
                    raise

    def _look(self) -> list[tuple[Job, Outcome | WorkerError]]:
        """Update the list of workers; return the files that lost workers were processing."""
        try:
            here = set(self._client.nthreads())
        except Exception as error:  # connection errors
            raise self._without_scheduler(error) from None
        for address in here - {*self._asked, *self._members, *self._refused}:
            self._asked[address] = self._submit(address, about, address)
        for address, future in list(self._asked.items()):
            if address not in here:
                self._asked.pop(address).release()
            elif future.done():
                self._add_member(address, self._asked.pop(address))
        self._refused = {address: reason for address, reason in self._refused.items() if address in here}
        self._members = {address: member for address, member in self._members.items() if address in here}
        lost = [job for job, (member, _) in self._busy.items() if member.address not in here]
        self._check_in_use()
        return [(job, self._lost(job)) for job in lost]

    def _add_member(self, address: str, future: Future[Member]) -> None:
        """Accept a worker that has described itself, unless it cannot do the work."""
        try:
            member = future.result(timeout=REPLY_TIMEOUT_S)
        except Exception as error:
            if future.status == "error":  # else the worker has left meanwhile
                self._refused[address] = dask_message(error)
            return
        reason = mismatch(member.version, __version__, member.folder, self._folder)
        if reason is not None:
            self._refused[address] = f"it {reason}"
        elif member.process not in self._unresponsive:
            self._members[address] = member

    def _lost(self, job: Job) -> WorkerError:
        member, future = self._busy.pop(job)
        future.release()
        return WorkerError(f"the worker {member.address} that did the work is gone: memory may be short there")

    def _check_in_use(self) -> None:
        """Raise WorkerError if no worker can be used, or none joins within the time limit."""
        now = time.monotonic()
        if self._members or self._busy:
            self._in_use = now
        elif self._refused and not self._asked:
            address, reason = next(iter(self._refused.items()))
            raise WorkerError(f"the worker {address} cannot be used: {reason}")
        elif now > self._in_use + WORKER_TIMEOUT_S:
            raise no_workers(self._scheduler, WORKER_TIMEOUT_S)

    def _restart(self, address: str) -> None:
        with suppress(Exception):  # there is no nanny, or the worker has already left
            self._client.restart_workers([address], timeout=REPLY_TIMEOUT_S, raise_for_error=False)
