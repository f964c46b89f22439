"""Progress bars on stderr."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from cascadenorm.execution.progress import Listener, Progress


@contextmanager
def progress_bar(text: str, *, time_left: bool = False) -> Iterator[Listener]:
    """Show the completed fraction on a terminal, optionally with the estimated time left."""
    with _bars(*((TimeRemainingColumn(),) if time_left else ())) as bar:
        task = bar.add_task(text, total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)


@contextmanager
def progress_tasks(*, log: bool = False) -> Iterator[Progress]:
    """Show a bar on the terminal for each running task; several tasks may run at once.

    Parameters
    ----------
    log
        Also print a line for each finished task, even without a terminal.
    """
    with _bars() as bar:
        started: dict[str, TaskID] = {}

        def show(task: str, done: int, total: int, note: str = "") -> None:
            if task not in started:
                started[task] = bar.add_task(task, total=total)
            text = f"{task}  {note}" if note else task
            bar.update(started[task], completed=done, description=text)
            if done == total:
                bar.remove_task(started.pop(task))
                if log:
                    bar.console.print(f"{text}: done", highlight=False)

        yield show


@contextmanager
def _bars(*further: ProgressColumn) -> Iterator[Bars]:
    console = Console(stderr=True, markup=False)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), *further)
    bars = Bars(*columns, console=console, transient=True, disable=not console.is_terminal)
    if bars.disable:  # rich 14 prints a newline even for a disabled bar
        yield bars
    else:
        with bars:
            yield bars
