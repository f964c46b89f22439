"""Watched sources: a file is taken once it has stopped changing."""

import time
from collections.abc import Callable, Container, Sequence

from cascadenorm.batch.inputs import Job, same_output
from cascadenorm.errors import ReadError

SCAN = 0.5
"""Least number of seconds between two scans of the sources."""

SCANNING = 20
"""The next scan waits this many times as long as the shorter of the last two took, so that scans take about 5 % of the
time; what one of them did once, such as to load a library, does not count."""


class Watched:
    """Files that settle while they are watched.

    A scan that fails, as of a network share or a server that is gone for a moment, does not end the watch.

    Parameters
    ----------
    find
        Lists the files that are there, and those that were named and are not.
    seconds
        How long a file must have stayed the same.
    complain
        Called with what is wrong with a scan, once until a scan is in order again; and with each file whose result
        would replace that of another.
    """

    def __init__(self, find: Callable[[], list[Job]], seconds: float, complain: Callable[[Exception], object]) -> None:
        self._find, self._settled, self._complain = find, Settled(seconds), complain
        self._next = self._took = 0.0
        self._in_order = True
        self._owners: dict[str, Job] = {}  # of the outputs
        self._refused: set[str] = set()

    def take(self, busy: Container[str]) -> list[Job]:
        """Return the files that have settled since the last scan, if the next is due, but those that are worked on."""
        begin = time.monotonic()
        if begin < self._next:
            return []
        found, wrong = self._scan()
        end = time.monotonic()
        took, self._took = self._took, end - begin
        self._next = end + max(SCAN, SCANNING * min(took, self._took))
        if wrong is not None and self._in_order:
            self._complain(wrong)
        self._in_order = wrong is None
        settled = self._settled.take([job for job in found if job.source not in busy])
        return [job for job in settled if self._owns_output(job)]

    def _scan(self) -> tuple[list[Job], Exception | None]:
        """Return the files that are there, and what is wrong."""
        try:
            found = self._find()
        except (ReadError, OSError) as error:
            return [], error
        missing = ", ".join(job.source for job in found if job.changed is None)
        wrong = ReadError(f"{missing}: not there at present", hint="the watch goes on") if missing else None
        return [job for job in found if job.changed is not None], wrong

    def _owns_output(self, job: Job) -> bool:
        """Test whether the result of a file replaces none of another; complain once where it would."""
        owner = self._owners.setdefault(job.output, job)
        if owner.source == job.source:
            return True
        if job.source not in self._refused:
            self._refused.add(job.source)
            self._complain(same_output(owner, job))
        return False


class Settled:
    """Files whose size and time of change have stayed the same for a while.

    Parameters
    ----------
    seconds
        How long they must have.
    clock
        Seconds since an arbitrary time.
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
