"""Decide which file a batch processes next, where, and with how many threads.

The largest files start first, and as many run in parallel as cores and memory allow.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cascadenorm.batch.inputs import Job
from cascadenorm.execution.memory import FACE_BYTES, PROCESS_BYTES

FACE_IN_FILE = {".stl": 50, ".obj": 35, ".off": 30}
"""Minimum number of bytes per face in a file, by extension; `LEAST_BYTES_A_FACE` applies to other formats."""
LEAST_BYTES_A_FACE = 18

ALIKE = 0.9  # places with at least this fraction of the memory of the largest place count as equally large


def needed(job: Job) -> int:
    """Estimate the bytes of memory needed to process a file, from its size."""
    file_bytes = FACE_IN_FILE.get(Path(job.source).suffix.lower(), LEAST_BYTES_A_FACE)  # per face
    return PROCESS_BYTES + job.size * FACE_BYTES // file_bytes


@dataclass(eq=False)
class Place:
    """Resources that processes share: this machine, or one worker of a cluster."""

    cores: int  # total number of threads
    memory: int  # total in bytes
    processes: int  # maximum number
    running: dict[Job, int] = field(default_factory=dict)  # files in progress, with their memory estimates in bytes


class Schedule:
    """The files that wait and the files in progress.

    Files run in parallel as long as their estimates fit into the memory of the place. A file that fits nowhere runs
    alone in the largest place. A retried file also runs alone, because memory may have been short.
    """

    def __init__(self) -> None:
        self._waiting: list[Job] = []
        self._alone: list[Job] = []
        self._running: dict[Job, Place] = {}

    @property
    def left(self) -> int:
        """Number of files that wait or run."""
        return len(self._waiting) + len(self._alone) + len(self._running)

    def add(self, jobs: list[Job]) -> None:
        """Add files to the queue."""
        self._waiting = sorted([*self._waiting, *jobs], key=lambda job: (-job.size, job.source))

    def retry(self, job: Job) -> None:
        """Add a file to be retried alone after all others have started."""
        self._alone.append(job)

    def next(self, places: Sequence[Place]) -> tuple[Place, Job, int] | None:
        """Start the largest file that fits now; return its place, the file, and its number of threads.

        Return None if no file waits or none fits.
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
        """Record that a file has ended."""
        del self._running.pop(job).running[job]

    def _begin(self, place: Place, job: Job, need: int) -> tuple[Place, Job, int]:
        """Start a file with its share of the cores, by number of processes or by memory, whichever is more."""
        by_number = place.cores // min(place.processes, self.left + 1)
        self._running[job] = place
        place.running[job] = need
        by_memory = int(place.cores * min(1.0, need / place.memory))
        return place, job, max(1, by_number, by_memory)
