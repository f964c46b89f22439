"""Watched folders: a file is taken once it has stopped changing."""

import time
from collections.abc import Callable, Sequence

from cascadenorm.batch.inputs import Job


class Settled:
    """Files whose size and time of change have stayed the same for a while.

    Parameters
    ----------
    seconds : how long they must have
    clock : seconds since an arbitrary time
    """

    def __init__(self, seconds: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._seconds, self._clock = seconds, clock
        self._seen: dict[str, tuple[Job, float]] = {}
        self._taken: set[Job] = set()

    def take(self, jobs: Sequence[Job]) -> list[Job]:
        """Return those of the files that are there now that have settled since; each once until it changes again."""
        now = self._clock()
        self._seen = {
            job.source: (job, self._seen[job.source][1] if self._seen.get(job.source, (None,))[0] == job else now)
            for job in jobs
        }
        settled = [job for job, since in self._seen.values() if now - since >= self._seconds and job not in self._taken]
        self._taken.update(settled)
        return settled
