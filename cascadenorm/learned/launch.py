"""What a training tells while it runs, and which of its processes does; without torch."""

import os
from typing import Protocol

from cascadenorm.learned.config import ConfigError


class Progress(Protocol):
    """What a training tells while it runs."""

    def __call__(self, task: str, done: int, total: int, note: str = "") -> object:
        """Say that `done` of `total` parts of a task are done."""


def alone() -> bool:
    """Whether this process is the only one; a scheduler may have numbered it all the same.

    Raises
    ------
    ConfigError : there are several, but it was not torchrun that started them
    """
    if os.environ.get("WORLD_SIZE", "1") == "1":
        return True
    if missing := [name for name in ("RANK", "LOCAL_RANK", "LOCAL_WORLD_SIZE") if name not in os.environ]:
        raise ConfigError(f"WORLD_SIZE is set and {missing[0]} is not: start processes with torchrun, or unset it")
    return False


def tells() -> bool:
    """Whether this process is the one that tells and writes: the only one, or the first of those of torchrun."""
    return alone() or os.environ["RANK"] == "0"


def leads() -> bool:
    """Whether this process is the first one on its machine, which sees to the files there."""
    return alone() or os.environ["LOCAL_RANK"] == "0"


def silent(task: str, done: int, total: int, note: str = "") -> None:
    """Tell nothing."""
