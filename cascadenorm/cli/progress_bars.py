"""Progress bars on stderr."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from time import monotonic
from typing import TYPE_CHECKING

from cascadenorm.execution.progress import Listener, Progress

if TYPE_CHECKING:  # rich is slow to import, and short commands show no bar
    from rich.progress import Progress as Bars
    from rich.progress import TaskID

BAR_AFTER_S = 0.5  # seconds after which the progress bar of one task appears


@contextmanager
def progress_bar(text: str, *, time_left: bool = False) -> Iterator[Listener]:
    """Show the completed fraction on a terminal, optionally with the estimated time left, unless the task is short."""
    if not sys.stderr.isatty():
        yield lambda fraction: None
        return
    start = monotonic()
    with ExitStack() as opened:
        shown: list[Listener] = []

        def show(fraction: float) -> None:
            if not shown and monotonic() - start >= BAR_AFTER_S:
                bar = opened.enter_context(_bars(time_left=time_left))
                task = bar.add_task(text, total=1.0)
                shown.append(lambda fraction: bar.update(task, completed=fraction))
            for listener in shown:
                listener(fraction)

        yield show


@contextmanager
def progress_tasks(*, log: bool = False) -> Iterator[Progress]:
    """Show a bar on the terminal for each running task; several tasks may run at once.

    With `log`, also print a line for each finished task, even without a terminal.
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
def _bars(*, time_left: bool = False) -> Iterator["Bars"]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True, markup=False)
    further = (TimeRemainingColumn(),) if time_left else ()
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), *further)
    bars = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    if bars.disable:  # rich 14 prints a newline even for a disabled bar
        yield bars
    else:
        with bars:
            yield bars
