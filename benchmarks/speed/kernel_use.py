"""What the kernels of a method do: how often they go over the mesh, what they read and write, how long they take."""

import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cascadenorm.mesh import in_blocks, parallel_for

BLOCKS = "matrix products in blocks"
"""What stands for the calls of `in_blocks`, less the kernels that they call."""


@dataclass
class Use:
    """What one kernel did.

    Parameters
    ----------
    rows
        Faces, vertices or edges that it went over, all passes together.
    bytes
        Least that it reads and writes: each array once a pass, as far as the pass goes over it.
    times
        Processor time of each call, in seconds.
    """

    rows: int = 0
    bytes: float = 0.0
    times: list[float] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Processor time of all threads."""
        return sum(self.times)


class _Clock(threading.local):
    """Processor time that calls within the present one have taken, on each thread."""

    inner = 0.0


@contextmanager
def watched() -> Iterator[dict[str, Use]]:
    """Watch the kernels that are called inside the block, by module and name."""
    uses: dict[str, Use] = defaultdict(Use)
    clock = _Clock()

    def timed(use: Use, work: Callable[..., Any]) -> Callable[..., Any]:
        def done(*arguments: Any) -> Any:
            before, outer, clock.inner = time.thread_time(), clock.inner, 0.0
            try:
                return work(*arguments)
            finally:
                spent = time.thread_time() - before
                use.times.append(spent - clock.inner)
                clock.inner = outer + spent

        return done

    def over_ranges(count: int, run: Callable[..., Any], *arguments: Any, **settings: Any) -> Any:
        name = f"{run.__module__.removeprefix('cascadenorm.')}.{run.__name__.strip('_')}"
        use = uses[name]
        use.rows += count
        use.bytes += least_bytes(count, arguments)
        return parallel_for(count, timed(use, run), *arguments, **settings)

    def over_blocks(count: int, run: Callable[..., Any]) -> Any:
        use = uses[BLOCKS]
        use.rows += count
        return in_blocks(count, timed(use, run))

    replaced = {parallel_for: over_ranges, in_blocks: over_blocks}
    modules = [module for name, module in sys.modules.items() if name.startswith("cascadenorm.")]
    places = [(vars(m), key, value) for m in modules for key, value in vars(m).items() if _is_key(value, replaced)]
    try:
        for names, key, value in places:
            names[key] = replaced[value]
        yield uses
    finally:
        for names, key, value in places:
            names[key] = value


def _is_key(value: object, keys: dict[Any, Any]) -> bool:
    return any(value is key for key in keys)


def least_bytes(count: int, arguments: tuple[Any, ...]) -> float:
    """Return what a pass over `count` rows moves at least: its arrays, or the share of them that it goes over."""
    arrays = {id(a): a for argument in arguments for a in _arrays(argument)}.values()
    lengths = [len(a) for a in arrays if a.ndim > 1 and a.dtype.kind == "f"]
    return sum(a.nbytes for a in arrays) * min(1.0, count / max(1, min(lengths, default=count)))


def _arrays(argument: Any) -> list[np.ndarray[Any, Any]]:
    if isinstance(argument, np.ndarray):
        return [argument]
    return [a for a in argument if isinstance(a, np.ndarray)] if isinstance(argument, tuple) else []
