"""Which file is next, where, and on how many threads: as many at once as cores and memory allow, largest first."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cascadenorm.batch.inputs import Job
from cascadenorm.execution.memory import FACE, PROCESS

FACE_IN_FILE = {".stl": 50, ".obj": 35, ".off": 30}
"""Bytes of a file for each face at least; in other formats `LEAST_BYTES_A_FACE`."""
LEAST_BYTES_A_FACE = 18

ALIKE = 0.9
"""Places with this fraction of the memory of the largest count as large as it."""


def needed(job: Job) -> int:
    """Estimate the bytes that the work on a file needs, from its size."""
    return PROCESS + job.size * FACE // FACE_IN_FILE.get(Path(job.source).suffix.lower(), LEAST_BYTES_A_FACE)


@dataclass(eq=False)
class Place:
    """What processes share: this machine, or one worker of a cluster.

    Parameters
    ----------
    cores
        Threads of all processes together.
    memory
        Bytes of all processes together.
    processes
        At most.
    running
        The files that are being worked on, with their estimates.
    """

    cores: int
    memory: int
    processes: int
    running: dict[Job, int] = field(default_factory=dict)


class Schedule:
    """The files that wait, and those that are being worked on.

    A file runs beside others while their estimates fit into the memory of the place; one that does not fit anywhere
    runs alone in the largest. So does a file that is tried again, since memory may have been short.
    """

    def __init__(self) -> None:
        self._waiting: list[Job] = []
        self._alone: list[Job] = []
        self._running: dict[Job, Place] = {}

    @property
    def left(self) -> int:
        """Files that wait or run."""
        return len(self._waiting) + len(self._alone) + len(self._running)

    def add(self, jobs: list[Job]) -> None:
        """Add files."""
        self._waiting = sorted([*self._waiting, *jobs], key=lambda job: (-job.size, job.source))

    def again(self, job: Job) -> None:
        """Add a file that is to run alone, when no other waits."""
        self._alone.append(job)

    def next(self, places: Sequence[Place]) -> tuple[Place, Job, int] | None:
        """Begin the largest file that fits somewhere now; return its place, it, and its number of threads.

        None where no file waits, or none fits.
        """
        largest = max((place.memory for place in places), default=0)
        for place in sorted(places, key=lambda place: -place.memory):
            if len(place.running) >= place.processes:
                continue
            empty = not place.running and place.memory >= ALIKE * largest
            if self._alone and not self._waiting and empty:
                return self._begin(place, self._alone.pop(0), place.memory)
            free = place.memory - sum(place.running.values())
            for number, job in enumerate(self._waiting):
                if empty or needed(job) <= free:
                    return self._begin(place, self._waiting.pop(number), needed(job))
        return None

    def end(self, job: Job) -> None:
        """Say that the work on a file has ended."""
        del self._running.pop(job).running[job]

    def _begin(self, place: Place, job: Job, need: int) -> tuple[Place, Job, int]:
        """A file has its share of the cores: by number, or by memory where that is more."""
        by_number = place.cores // min(place.processes, self.left + 1)
        self._running[job] = place
        place.running[job] = need
        by_memory = int(place.cores * min(1.0, need / place.memory))
        return place, job, max(1, by_number, by_memory)
