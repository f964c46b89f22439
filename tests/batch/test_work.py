"""The work of a process on one file, and processes that do it."""

from contextlib import closing

from batches import BALL, job, scans
from shapes import noisy

from cascadenorm.batch.inputs import Job
from cascadenorm.batch.processes import LocalProcesses
from cascadenorm.batch.scheduling import Place
from cascadenorm.batch.work import Outcome, Task, batch_settings, work
from cascadenorm.errors import WorkerError
from cascadenorm.execution.memory import PROCESS_BYTES
from cascadenorm.io.interop import save_mesh


def test_a_file_that_changes_while_it_is_read_is_tried_again(place):
    scans(place, 1)
    settings = batch_settings("laplacian", {}, {}, None, force=False)[0]
    task = Task(Job("a/0.ply", "out/a/0.ply", 0, 0), None)
    checked = work(settings, task)
    assert checked.status == "new"
    save_mesh(place / "a" / "0.ply", noisy(BALL, 0.1), force=True)
    found = work(settings, task._replace(checked=True, digest=checked.input_digest))
    assert (found.status, found.then) == ("failed", "retry") and "changed while it was read" in str(found.error)
    assert not (place / "out" / "a" / "0.ply").exists()
    missing = work(settings, Task(Job("a/1.ply", "out/a/1.ply", 0, None), None))
    assert (missing.status, missing.then) == ("failed", "continue")
    gone = work(settings, Task(Job("a/1.ply", "out/a/1.ply", 10, 5), None))  # since it was listed
    assert (gone.status, gone.then) == ("failed", "retry")
    assert str(missing.error) == "a/1.ply does not exist: check the name"


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
