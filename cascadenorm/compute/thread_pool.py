"""The threads of this process that work for others: started when first needed, and kept, since starting them takes as
long as many a kernel."""

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from typing import TypeVar

Result = TypeVar("Result")


class _Pool:
    """A thread for each CPU at most, whatever callers ask for; a process that was forked inherits none of them."""

    def __init__(self) -> None:
        self.renew()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self.renew)

    def renew(self) -> None:
        self.executor = ThreadPoolExecutor(os.cpu_count(), "cascadenorm")


_pool = _Pool()


def on_threads(threads: int, count: int, task: Callable[[int], Result]) -> list[Result]:
    """Call task(0) … task(count - 1) on the calling thread and on up to threads - 1 others.

    Each thread claims the next number as soon as it is done with one. The caller works like the others, so a call ends
    even where they are all busy, or where it comes from one of them. After an error no further number is claimed.

    Returns
    -------
    what the calls returned, in order

    Raises
    ------
    what a call raised, the one with the smallest number where several did
    """
    if min(threads, count) <= 1:
        return [task(number) for number in range(count)]
    waiting, results, errors = deque(range(count)), dict[int, Result](), dict[int, BaseException]()

    def work() -> None:
        with suppress(IndexError):  # of popleft, at the end
            while not errors:
                number = waiting.popleft()
                try:
                    results[number] = task(number)
                except BaseException as error:
                    errors[number] = error

    others = [_pool.executor.submit(work) for _ in range(min(threads, count) - 1)]
    try:
        work()
    finally:  # at Ctrl-C as well, nothing of the call goes on
        waiting.clear()
        wait([other for other in others if not other.cancel()])
    if errors:
        raise errors[min(errors)]
    return [results[number] for number in range(count)]
