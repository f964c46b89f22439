"""Loops compiled by numba, kept on disk for the next process."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar, cast

import numba

from cascadenorm.compute.compile_time import watch_compiler

KernelLoop = TypeVar("KernelLoop", bound=Callable[..., Any])

with suppress(Exception):  # of a numba whose events are others than those known here: then compiling goes uncounted
    watch_compiler()


def kernel(function: KernelLoop) -> KernelLoop:
    """Compile a loop: it releases the interpreter, divides by zero as numpy does, and is kept on disk for next time.

    Where neither the package's folder nor the user's can be written, it is compiled in each process; so it is with a
    numba whose cache is another than the one known here. numba's own is no substitute: processes may mix up its files.
    """
    compiled: Any = numba.njit(nogil=True, error_model="numpy")(function)
    if compiled is not function:  # which it is where compilation is switched off
        with suppress(Exception):
            from cascadenorm.compute.kernel_cache import KernelCache

            compiled._cache = KernelCache(function)
    return cast(KernelLoop, compiled)
