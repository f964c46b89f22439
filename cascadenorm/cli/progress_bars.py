"""Progress on a terminal, on stderr."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from cascadenorm.learned import launch


@contextmanager
def progress_bar(text: str) -> Iterator[Callable[[float], object]]:
    """Show the share that is done, on a terminal."""
    with _progress() as bar:
        task = bar.add_task(text, total=1.0)
        yield lambda share: bar.update(task, completed=share)


@contextmanager
def progress_steps() -> Iterator[Callable[[str, int, int], object]]:
    """Show what is being done and how many parts are done, on a terminal."""
    with _progress() as bar:
        task = bar.add_task("", total=None)
        yield lambda text, done, total: bar.update(task, description=text, completed=done, total=total)


@contextmanager
def progress_tasks() -> Iterator[launch.Progress]:
    """Show tasks as they begin and end, several at once: bars on a terminal, else a line for each that is finished."""
    with _progress() as bar:
        started: dict[str, TaskID] = {}

        def show(task: str, done: int, total: int, note: str = "") -> None:
            if task not in started:
                started[task] = bar.add_task(task, total=total)
            text = f"{task}  {note}" if note else task
            bar.update(started[task], completed=done, description=text)
            if done == total:
                bar.remove_task(started.pop(task))
                bar.console.print(f"{text}: done", highlight=False)

        yield show


def _progress() -> Progress:
    console = Console(stderr=True, markup=False)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
