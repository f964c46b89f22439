"""Progress: the fraction of one method that is done, and the parts of a longer task."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Protocol

Listener = Callable[[float], object]
"""Called with the fraction done, from 0 to 1; what it raises ends the method."""


class Progress(Protocol):
    """Called as work of many parts goes on, such as an evaluation or a training; what it raises ends the work."""

    def __call__(self, task: str, done: int, total: int, note: str = "") -> object:
        """Say that `done` of `total` parts of a task are done; the note tells what comes next or what came out."""


def silent(task: str, done: int, total: int, note: str = "") -> None:
    """Say nothing."""


@dataclass
class _Span:
    """The part of the whole, from 0 to 1, that the current step takes."""

    listener: Listener
    reported: float = 0.0
    begin: float = 0.0
    length: float = 1.0


_span: ContextVar[_Span | None] = ContextVar("span", default=None)


@contextmanager
def report_to(listener: Listener | None) -> Iterator[None]:
    """Report the progress of each `track` inside the block to a listener, or to none."""
    token = _span.set(None if listener is None else _Span(listener))
    try:
        yield
    finally:
        _span.reset(token)


def track(count: int) -> Iterator[int]:
    """Count 0 … count - 1, reporting the progress before each; a count within a step is a part of that step."""
    span = _span.get()
    if span is None:
        yield from range(count)
        return
    begin, length = span.begin, span.length
    for step in range(count):
        span.begin, span.length = begin + length * step / count, length / count
        span.reported = max(span.reported, span.begin)  # a method may count several times, one after the other
        span.listener(span.reported)
        yield step
    span.begin, span.length = begin, length
