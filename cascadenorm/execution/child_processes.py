"""Control the start and end of child processes."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import parent_process, resource_tracker
from threading import Thread

TERMINATION_TIMEOUT_S = 5.0
"""Seconds that a process has to remove its temporary files."""


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Block SIGINT within the context, and permanently in processes started within it."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # otherwise the first process would start it, which unblocks SIGINT
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with_parent() -> None:
    """End this process when its parent exits: by SIGTERM and, if that has no effect, immediately."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(TERMINATION_TIMEOUT_S)
        os._exit(1)

    Thread(target=watch, daemon=True).start()
