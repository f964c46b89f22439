"""Steps of a method, told to whoever waits for it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

Listener = Callable[[float], object]
"""Told the share that is done, from 0 to 1; what it raises ends the method."""


@dataclass
class _Span:
    """The part of the whole, from 0 to 1, that the present step takes."""

    listener: Listener
    told: float = 0.0
    begin: float = 0.0
    length: float = 1.0


_span: ContextVar[_Span | None] = ContextVar("span", default=None)


@contextmanager
def report_to(listener: Listener | None) -> Iterator[None]:
    """Let `track` inside the block tell this listener how far they are; None: nobody."""
    token = _span.set(None if listener is None else _Span(listener))
    try:
        yield
    finally:
        _span.reset(token)


def track(count: int) -> Iterator[int]:
    """Count 0 … count - 1, and tell before each how far it is; steps within a step are a part of it."""
    span = _span.get()
    if span is None:
        yield from range(count)
        return
    begin, length = span.begin, span.length
    for step in range(count):
        span.begin, span.length = begin + length * step / count, length / count
        span.told = max(span.told, span.begin)  # a method may count several times, one after the other
        span.listener(span.told)
        yield step
    span.begin, span.length = begin, length
