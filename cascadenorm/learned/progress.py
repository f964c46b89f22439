"""What a training tells while it runs."""

import os
from typing import Protocol


class Progress(Protocol):
    """What a training tells while it runs."""

    def __call__(self, task: str, done: int, total: int, note: str = "") -> object:
        """Say that `done` of `total` parts of a task are done."""


def alone() -> bool:
    """Whether this process is the only one; a scheduler may have numbered it all the same."""
    return os.environ.get("WORLD_SIZE", "1") == "1"


def tells() -> bool:
    """Whether this process is the one that tells and writes: the only one, or the first of those of torchrun."""
    return alone() or os.environ["RANK"] == "0"


def leads() -> bool:
    """Whether this process is the first one on its machine, which sees to the files there."""
    return alone() or os.environ["LOCAL_RANK"] == "0"


def silent(task: str, done: int, total: int, note: str = "") -> None:
    """Tell nothing."""
