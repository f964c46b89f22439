"""Progress of a method, reported to a listener."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

Listener = Callable[[float], object]
"""Called with the fraction done, from 0 to 1; what it raises ends the method."""


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
