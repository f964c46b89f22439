"""Measurement and notification of kernel compilation.

The first run compiles kernels for many seconds; later runs load them from disk. Compilation must not be counted as the
run time of a method.
"""

import time
from collections.abc import Callable
from typing import Any

NOTICE = "compiling kernels for their first use"


class _Clock:
    """Time spent in the outermost compilations of this process; numba compiles on one thread at a time."""

    def __init__(self) -> None:
        self.seconds, self.depth, self.start = 0.0, 0, 0.0
        self.tell: Callable[[str], object] | None = None

    def begin(self) -> None:
        """Record the start of a compilation, which may be nested in another one."""
        if self.depth == 0:
            self.start = time.perf_counter()
        self.depth += 1
        if self.tell is not None:
            tell, self.tell = self.tell, None
            tell(NOTICE)

    def end(self) -> None:
        """Add the duration of the outermost compilation."""
        self.depth -= 1
        if self.depth == 0:
            self.seconds += time.perf_counter() - self.start


_clock = _Clock()


def watch_compiler() -> None:
    """Measure numba's compilations from now on."""
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            _clock.begin()

        def on_end(self, event: Any) -> None:
            _clock.end()

    event.register("numba:compile", Listener())  # type: ignore[no-untyped-call]


def tell_of_compiling(tell: Callable[[str], object] | None) -> None:
    """Pass NOTICE to a function once, when the next compilation begins; None disables the notice."""
    _clock.tell = tell


class Stopwatch:
    """Seconds since creation, excluding kernel compilation."""

    def __init__(self) -> None:
        self._start, self._compiled = time.perf_counter(), _clock.seconds

    def seconds(self) -> float:
        compiled = _clock.seconds - self._compiled
        return max(0.0, time.perf_counter() - self._start - compiled)
