"""The rank of this process in a training, determined without torch."""

import os

from cascadenorm.learned.config import ConfigError


def is_single_process() -> bool:
    """Whether this process is the only one, even if a scheduler has set its rank.

    Raises ConfigError if there are several processes that were not started by torchrun.
    """
    if os.environ.get("WORLD_SIZE", "1") == "1":
        return True
    if missing := [name for name in ("RANK", "LOCAL_RANK", "LOCAL_WORLD_SIZE") if name not in os.environ]:
        raise ConfigError(f"WORLD_SIZE is set and {missing[0]} is not: start processes with torchrun, or unset it")
    return False


def is_main() -> bool:
    """Whether this process reports and writes: it is the only one or has rank 0."""
    return is_single_process() or os.environ["RANK"] == "0"


def is_local_main() -> bool:
    """Whether this process has local rank 0 and therefore manages the files on its machine."""
    return is_single_process() or os.environ["LOCAL_RANK"] == "0"
