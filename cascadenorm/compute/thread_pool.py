"""A persistent thread pool for kernels, started on first use."""

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from typing import TypeVar

Result = TypeVar("Result")


class _Pool:
    """At most one thread per CPU, regardless of what callers request; a forked process starts a new pool."""

    def __init__(self) -> None:
        self.renew()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self.renew)

    def renew(self) -> None:
        self.executor = ThreadPoolExecutor(os.cpu_count(), "cascadenorm")


_pool = _Pool()


def on_threads(threads: int, count: int, task: Callable[[int], Result]) -> list[Result]:
    """Call task(0) … task(count - 1) on the calling thread and up to threads - 1 others; return the results in order.

    Each thread takes the next number when it has finished the last one. The calling thread works too, so nested calls
    and calls while all threads are busy still finish. After an error, no further number is taken, and the error of the
    failing call with the lowest number is raised.
    """
    if min(threads, count) <= 1:
        return [task(number) for number in range(count)]
    waiting, results, errors = deque(range(count)), dict[int, Result](), dict[int, BaseException]()

    def work() -> None:
        with suppress(IndexError):  # popleft: no numbers are left
            while not errors:
                number = waiting.popleft()
                try:
                    results[number] = task(number)
                except BaseException as error:
                    errors[number] = error

    others = [_pool.executor.submit(work) for _ in range(min(threads, count) - 1)]
    try:
        work()
    finally:  # leave no task running, even after Ctrl-C
        waiting.clear()
        wait([other for other in others if not other.cancel()])
    if errors:
        raise errors[min(errors)]
    return [results[number] for number in range(count)]
