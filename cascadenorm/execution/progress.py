"""Report the progress of a method or of a task with several parts."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Protocol

Listener = Callable[[float], object]
"""Called with the completed fraction, from 0 to 1; an exception it raises ends the method."""


class Cancelled(Exception):
    """Raised by the listener of work that was cancelled."""


class Progress(Protocol):
    """Callback for work with many parts, such as evaluation or training; an exception it raises ends the work."""

    def __call__(self, task: str, done: int, total: int, note: str = "") -> object:
        """Report that `done` of `total` parts of a task are done; the note describes the next step or the result."""


def no_progress(task: str, done: int, total: int, note: str = "") -> None:
    """Ignore the progress."""


@dataclass
class _Span:
    """The interval of the total progress, within 0 … 1, that the current step covers."""

    listener: Listener
    reported: float = 0.0
    begin: float = 0.0
    length: float = 1.0


_span: ContextVar[_Span | None] = ContextVar("span", default=None)


@contextmanager
def report_to(listener: Listener | None) -> Iterator[None]:
    """Report the progress of each `track` within the context to a listener; None reports nothing."""
    token = _span.set(None if listener is None else _Span(listener))
    try:
        yield
    finally:
        _span.reset(token)


def track(count: int) -> Iterator[int]:
    """Yield 0 … count - 1 and report the progress before each; a nested call covers its part of the current step."""
    span = _span.get()
    if span is None:
        yield from range(count)
        return
    begin, length = span.begin, span.length
    for step in range(count):
        span.begin, span.length = begin + length * step / count, length / count
        span.reported = max(span.reported, span.begin)  # a method may call this several times in sequence
        span.listener(span.reported)
        yield step
    span.begin, span.length = begin, length
