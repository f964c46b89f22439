"""What a training tells while it runs."""

import os
from typing import Protocol


class Progress(Protocol):
    """What a training tells while it runs."""

    def __call__(self, task: str, done: int, total: int, note: str = "") -> object:
        """Say that `done` of `total` parts of a task are done."""


def tells() -> bool:
    """Whether this process is the one that tells and writes: the only one, or the first of those of torchrun."""
    return os.environ.get("RANK", "0") == "0"


def silent(task: str, done: int, total: int, note: str = "") -> None:
    """Tell nothing."""
