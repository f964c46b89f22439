"""Which of the processes of a training this one is; without torch."""

import os

from cascadenorm.learned.config import ConfigError


def is_single_process() -> bool:
    """Whether this process is the only one; a scheduler may have numbered it all the same.

    Raises
    ------
    ConfigError
        There are several, but it was not torchrun that started them.
    """
    if os.environ.get("WORLD_SIZE", "1") == "1":
        return True
    if missing := [name for name in ("RANK", "LOCAL_RANK", "LOCAL_WORLD_SIZE") if name not in os.environ]:
        raise ConfigError(f"WORLD_SIZE is set and {missing[0]} is not: start processes with torchrun, or unset it")
    return False


def is_main() -> bool:
    """Whether this process reports and writes: it is the only one, or the first of those of torchrun."""
    return is_single_process() or os.environ["RANK"] == "0"


def is_local_main() -> bool:
    """Whether this process is the first one on its machine, which sees to the files there."""
    return is_single_process() or os.environ["LOCAL_RANK"] == "0"
