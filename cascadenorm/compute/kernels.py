"""Loops compiled by numba and cached on disk."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar, cast

import numba

from cascadenorm.compute.compile_time import watch_compiler

KernelLoop = TypeVar("KernelLoop", bound=Callable[..., Any])

OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""Options of the compiler; numba does not declare the last one to type checkers."""

with suppress(Exception):  # a numba with incompatible events: compilation is not measured
    watch_compiler()


def kernel(function: KernelLoop, **options: Any) -> KernelLoop:
    """Compile a function with numba: it releases the GIL, divides by zero as numpy does, and is cached on disk.

    The options add to OPTIONS.

    It gets no wrapper for calls from C, which would have to be compiled and loaded as well.

    If no cache folder is writable, or numba's cache classes are incompatible, the function is compiled in each process.
    numba's own cache is not used instead, because concurrent processes may mix up its files.
    """
    compiled: Any = numba.njit(**OPTIONS, **options)(function)
    if compiled is not function:  # they are identical when compilation is disabled
        with suppress(Exception):
            from cascadenorm.compute.kernel_cache import KernelCache

            compiled._cache = KernelCache(function)
    return cast(KernelLoop, compiled)


def inlined(function: KernelLoop) -> KernelLoop:
    """Compile a function as a kernel that becomes a part of its callers, whose loops can then be vectorised."""
    return kernel(function, forceinline=True)


def inlined_sum(function: KernelLoop) -> KernelLoop:
    """Compile a function as a kernel that becomes a part of its callers and adds in the order of vector lanes."""
    return kernel(function, forceinline=True, fastmath={"reassoc", "nsz"})
