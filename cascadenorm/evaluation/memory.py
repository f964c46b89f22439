"""How much memory work needs at most."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


@dataclass
class Peak:
    """Megabytes beyond what the process had before; None where the system does not tell."""

    megabytes: float | None = None


@contextmanager
def peak_memory() -> Iterator[Peak]:
    """Measure the block: the largest resident memory of this process less that before (Linux)."""
    peak = Peak()
    try:
        _CLEAR.write_text("5", encoding="ascii")  # proc(5): resets the peak
        before = _kilobytes("VmRSS")
    except OSError:
        yield peak
        return
    yield peak
    peak.megabytes = max(0, _kilobytes("VmHWM") - before) * 1024 / 1e6


def _kilobytes(name: str) -> int:
    """Read a size of this process."""
    lines = _STATUS.read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{name}:"))
