"""Processes of a batch are stopped where their outcome cannot be read, and the others go on."""

from contextlib import closing

from batches import job

from cascadenorm.batch.processes import LocalProcesses
from cascadenorm.batch.scheduling import Place
from cascadenorm.batch.work import Outcome, Task
from cascadenorm.errors import WorkerError
from cascadenorm.execution.memory import PROCESS_BYTES


class OfLibrary(Exception):
    """An error that cannot be made again from its text, as that of lxml."""

    def __init__(self, line: int, column: int) -> None:
        super().__init__(f"line {line}, column {column}")


def answer(task: Task) -> Outcome:
    """An outcome that cannot be read where it arrives, for one file."""
    return Outcome(status="failed", error=OfLibrary(3, 4)) if task.job.source == "odd" else Outcome(status="kept")


def test_a_process_whose_outcome_cannot_be_read_is_stopped_and_the_others_go_on():
    tasks = [Task(job(1, name), None) for name in ("odd", "even")]
    with closing(LocalProcesses(answer, Place(2, PROCESS_BYTES, processes=2))) as processes:
        for task in tasks:
            processes.begin(processes.places[0], task, 1)
        begun = [worker._process for worker in processes._busy.values()]
        found = {}
        while len(found) < 2:
            found |= dict(processes.ended(60))
        assert found[tasks[1].job] == Outcome(status="kept")
        assert isinstance(found[tasks[0].job], WorkerError) and "cannot be read: TypeError" in str(found[tasks[0].job])
        assert [process.is_alive() for process in begun] == [False, True]
        processes.begin(processes.places[0], tasks[1], 1)
        assert processes.ended(60) == [(tasks[1].job, Outcome(status="kept"))]
    assert not begun[1].is_alive()
