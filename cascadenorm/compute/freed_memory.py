"""Return the memory of freed arrays to the system."""

import ctypes
from contextlib import suppress

RETURNED_BYTES = 16_000_000
"""Bytes of freed arrays from which memory is returned to the system, which takes about a millisecond."""


def return_freed_memory(size: int) -> None:
    """Return freed memory to the system if the arrays freed last, of `size` bytes, had at least RETURNED_BYTES.

    glibc keeps the memory of most freed arrays below 32 MiB, but few later arrays fit between those in use.
    """
    if size >= RETURNED_BYTES:
        with suppress(AttributeError, OSError, TypeError):  # other systems
            ctypes.CDLL(None).malloc_trim(0)
