"""What a training tells while it runs."""

from typing import Protocol


class Progress(Protocol):
    """What a training tells while it runs."""

    def __call__(self, task: str, done: int, total: int, note: str = "") -> object:
        """Say that `done` of `total` parts of a task are done."""


def silent(task: str, done: int, total: int, note: str = "") -> None:
    """Tell nothing."""
