"""Measure free memory and estimate the memory that work needs."""

import math
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from cascadenorm.errors import ParameterError

PROCESS_BYTES = 350_000_000  # bytes that a process uses before it reads anything, including kernels
FACE_BYTES = 1800  # bytes per face that the learned methods need, more than all others; measured in benchmarks/speed.md
OTHER_FACE_BYTES = 500  # minimum number of bytes per face that other methods need, including the file
USABLE_FRACTION = 0.8  # fraction of the free memory that is used by default

_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_MEMINFO, _GROUP, _GROUPS = Path("/proc/meminfo"), Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


@dataclass
class Peak:
    """Peak memory in megabytes above the initial memory of the process; None if the system does not report it."""

    megabytes: float | None = None


@contextmanager
def peak_memory() -> Iterator[Peak]:
    """Measure the increase of the peak resident memory of this process within the context (Linux)."""
    peak = Peak()
    try:
        _CLEAR.write_text("5", encoding="ascii")  # proc(5): resets the peak
        before = _kilobytes(_STATUS, "VmRSS")
    except OSError:
        yield peak
        return
    yield peak
    peak.megabytes = max(0, _kilobytes(_STATUS, "VmHWM") - before) * 1024 / 1e6


def free_memory() -> int | None:
    """Return the free memory within the limits of the control groups, in bytes; None if unknown (not Linux)."""
    try:
        free = 1024 * _kilobytes(_MEMINFO, "MemAvailable")
    except (OSError, StopIteration):
        return None
    return min(free, *_group_limits(), free)


def available_memory() -> int:
    """Return the bytes available to new work, or half of the machine's memory if the system does not report it."""
    free = free_memory()
    if free is None:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2 if hasattr(os, "sysconf") else 2**32
    return free


def _group_limits() -> Iterator[int]:
    """Yield the free memory of each control group (version 2) of this process."""
    try:
        own = next(line for line in _GROUP.read_text(encoding="ascii").splitlines() if line.startswith("0::"))
    except (OSError, StopIteration):
        return
    place = _GROUPS / own[3:].lstrip("/")
    for group in (place, *place.parents):
        try:
            limit = (group / "memory.max").read_text(encoding="ascii").strip()
            used = int((group / "memory.current").read_text(encoding="ascii"))
        except OSError:
            continue
        if limit != "max":
            yield max(0, int(limit) - used)


def parse_bytes(text: str | int) -> int:
    """Return the number of bytes for the setting `memory`, a number or text like "4GB". Raises ParameterError."""
    given = f"{text}B" if isinstance(text, int | float) else str(text)
    match = re.fullmatch(r"\s*(\d{1,99}(?:\.\d*)?)\s*(?:([kmgt]i?)b?|b)\s*", given, re.IGNORECASE)
    size = math.floor(float(match[1]) * _UNITS[(match[2] or "").lower()]) if match else 0
    if size < 1:
        raise ParameterError(
            f'is {text!r}; it must be an amount of memory with its unit, such as "4GB" or "500 MB"', parameter="memory"
        )
    return size


def format_bytes(size: int) -> str:
    """Format a number of bytes for messages."""
    if size < 1e6:
        return f"{size:,} bytes"
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.0f} MB"


def _kilobytes(table: Path, name: str) -> int:
    """Read a size from a table in /proc."""
    lines = table.read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{name}:"))
