"""Watch sources for new files and process each once it has stopped changing."""

import time
from collections.abc import Callable, Container

from cascadenorm.batch.inputs import Job, same_output
from cascadenorm.errors import ReadError

SCAN = 0.5  # minimum number of seconds between two scans of the sources

SCANNING = 20
"""Factor between the duration of a scan and the wait for the next one, so that scans use about 5 % of the time. The
shorter of the last two durations counts, which excludes one-time costs such as loading a library."""


class Watched:
    """Files that `find` lists, also named ones that are missing, and that stay unchanged for some seconds of the watch.

    A failed scan, for example of a temporarily unavailable network share or server, does not end the watch. `report`
    is called with the error of a failed scan, once until a scan succeeds again, and with each file whose result would
    replace that of another. A file has settled when its size and modification time stayed the same for those seconds.
    """

    def __init__(self, find: Callable[[], list[Job]], seconds: float, report: Callable[[Exception], object]) -> None:
        self._find, self._seconds, self._report = find, seconds, report
        self._next = self._took = 0.0
        self._in_order = True
        self._since: dict[Job, float] = {}  # time at which each file was first seen in its present state
        self._taken: set[Job] = set()
        self._owners: dict[str, Job] = {}  # by output
        self._refused: set[str] = set()

    def take(self, busy: Container[str]) -> list[Job]:
        """Return the newly settled files, except those in progress, each only once until it changes again.

        Return nothing if no scan is due.
        """
        begin = time.monotonic()
        if begin < self._next:
            return []
        found, wrong = self._scan()
        end = time.monotonic()
        took, self._took = self._took, end - begin
        self._next = end + max(SCAN, SCANNING * min(took, self._took))
        if wrong is not None and self._in_order:
            self._report(wrong)
        self._in_order = wrong is None
        self._since = {job: self._since.get(job, end) for job in found if job.source not in busy}
        settled = [job for job, since in self._since.items() if end - since >= self._seconds and job not in self._taken]
        self._taken.update(settled)
        return [job for job in settled if self._owns_output(job)]

    def _scan(self) -> tuple[list[Job], Exception | None]:
        """Return the existing files, and the error of the scan if it failed."""
        try:
            found = self._find()
        except (ReadError, OSError) as error:
            return [], error
        missing = ", ".join(job.source for job in found if job.changed is None)
        wrong = ReadError(f"{missing}: not there at present", hint="the watch continues") if missing else None
        return [job for job in found if job.changed is not None], wrong

    def _owns_output(self, job: Job) -> bool:
        """Test that the result of a file replaces no other result; report once that it would."""
        owner = self._owners.setdefault(job.output, job)
        if owner.source == job.source:
            return True
        if job.source not in self._refused:
            self._refused.add(job.source)
            self._report(same_output(owner, job))
        return False
