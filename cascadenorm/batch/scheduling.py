"""Which file is next, and on how many threads: as many at once as cores and memory allow, largest first."""

from pathlib import Path

from cascadenorm.batch.inputs import Job

PROCESS = 350_000_000
"""Bytes that a process takes before it has read anything, kernels included."""

FACE = 1800
"""Bytes that a face takes in the method that needs most, `auto`."""

FACE_IN_FILE = {".stl": 50, ".obj": 35, ".off": 30}
"""Bytes of a file for each face at least; in other formats `FEWEST`."""
FEWEST = 18


def needed(job: Job) -> int:
    """Estimate the bytes that the work on a file needs, from its size."""
    return PROCESS + job.size * FACE // FACE_IN_FILE.get(Path(job.source).suffix.lower(), FEWEST)


class Schedule:
    """The files that wait, and those that are being worked on.

    A file runs beside others while their estimates fit into memory; one that does not fit at all runs alone. A file
    that is tried again runs alone, since memory may have been short.

    Parameters
    ----------
    cores : threads of all processes together
    memory : bytes of all processes together
    """

    def __init__(self, cores: int, memory: int) -> None:
        self.cores, self.memory = cores, memory
        self._waiting: list[Job] = []
        self._alone: list[Job] = []
        self._running: dict[Job, int] = {}

    @property
    def left(self) -> int:
        """Files that wait or run."""
        return len(self._waiting) + len(self._alone) + len(self._running)

    def add(self, jobs: list[Job]) -> None:
        """Add files."""
        self._waiting = sorted([*self._waiting, *jobs], key=lambda job: (-job.size, job.source))

    def again(self, job: Job) -> None:
        """Add a file that is to run alone."""
        self._alone.append(job)

    def next(self) -> tuple[Job, int] | None:
        """Begin the largest file that fits now, and return it with its number of threads; None where there is none."""
        if self._alone and not self._waiting and not self._running:
            return self._begin(self._alone.pop(0), self.memory)
        free = self.memory - sum(self._running.values())
        for number, job in enumerate(self._waiting):
            if not self._running or needed(job) <= free:
                return self._begin(self._waiting.pop(number), needed(job))
        return None

    def end(self, job: Job) -> None:
        """Say that the work on a file has ended."""
        del self._running[job]

    def _begin(self, job: Job, need: int) -> tuple[Job, int]:
        """A file has its share of the cores: by number, or by memory where that is more."""
        self._running[job] = need
        by_number = self.cores // max(1, self.left)
        by_memory = int(self.cores * min(1.0, need / self.memory))
        return job, max(1, by_number, by_memory)
