"""How long numba compiles kernels, and who is told when it begins.

A first run compiles for many seconds what later runs load from disk. Nobody should take that for the time of a method.
"""

import time
from collections.abc import Callable
from typing import Any

NOTICE = "compiling kernels (first run only)"


class _Clock:
    """The time in the outermost compilations of this process; numba compiles on one thread at a time."""

    def __init__(self) -> None:
        self.seconds, self.depth, self.start = 0.0, 0, 0.0
        self.tell: Callable[[str], object] | None = None

    def begin(self) -> None:
        """Note when a compilation begins; one of a kernel that it calls lies within it."""
        if self.depth == 0:
            self.start = time.perf_counter()
        self.depth += 1
        if self.tell is not None:
            tell, self.tell = self.tell, None
            tell(NOTICE)

    def end(self) -> None:
        """Add what the outermost compilation took."""
        self.depth -= 1
        if self.depth == 0:
            self.seconds += time.perf_counter() - self.start


_clock = _Clock()


def watch_compiler() -> None:
    """Count the compilations of numba from now on."""
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            _clock.begin()

        def on_end(self, event: Any) -> None:
            _clock.end()

    event.register("numba:compile", Listener())  # type: ignore[no-untyped-call]


def tell_of_compiling(tell: Callable[[str], object] | None) -> None:
    """Pass NOTICE to a function, once, when this process compiles its first kernel; None tells nobody."""
    _clock.tell = tell


class Stopwatch:
    """Seconds since it was made, without those in which kernels were compiled."""

    def __init__(self) -> None:
        self._start, self._compiled = time.perf_counter(), _clock.seconds

    def seconds(self) -> float:
        """Return the seconds so far."""
        compiled = _clock.seconds - self._compiled
        return max(0.0, time.perf_counter() - self._start - compiled)
