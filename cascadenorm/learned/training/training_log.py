"""Training logs in CSV or JSON Lines and for TensorBoard."""

import csv
import io
import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Lock
from typing import NamedTuple, TextIO

from cascadenorm.errors import MissingDependencyError, OutputError, ParameterError, ReadError


class Pass(NamedTuple):
    """One epoch of training on the faces of a cluster; stages, clusters and epochs count from 1."""

    stage: int
    cluster: int
    epoch: int
    loss: float  # mean chord between predicted and true normals on the training faces
    validation: float  # the same on the validation faces
    validation_deg: float  # mean angle on the validation faces, in degrees


Recorder = Callable[[Pass], object]

LOG_EXTENSIONS = (".csv", ".jsonl")  # extensions of log files


def unrecorded(done: Pass) -> None:
    """Record nothing."""


@contextmanager
def recording(log: Path | None, tensorboard: Path | None, *, resumed: bool) -> Iterator[Recorder]:
    """Record epochs in a log file, as soon as each one finishes, and in a folder of TensorBoard events.

    The log file has an extension in LOG_EXTENSIONS, and its folder exists. A resumed training appends to it. None
    writes no file or no events. Raises MissingDependencyError if TensorBoard is needed and not installed, and
    OutputError if its folder cannot be written.
    """
    recorders: list[Recorder] = []
    lock = Lock()
    with ExitStack() as opened:
        if tensorboard is not None:  # first, since without its package no log is to be left behind
            recorders.append(opened.enter_context(_events(tensorboard)))
        if log is not None:
            file = opened.enter_context(log.open("a" if resumed else "w", encoding="utf-8", newline=""))
            recorders.append(_lines(file, log.suffix))

        def record(done: Pass) -> None:
            with lock:
                for one in recorders:
                    one(done)

        yield record


def checked_log(log: Path) -> Path:
    """Return the path of a log file. Raises ParameterError for an unknown extension."""
    if log.suffix not in LOG_EXTENSIONS:
        raise ParameterError(f"is {log}; it must end in {' or '.join(LOG_EXTENSIONS)}", parameter="log")
    return log


def read_passes(log: Path) -> list[Pass]:
    """Read a log file, in order. If an epoch was repeated after an interruption, the last record counts.

    Raises ReadError if the file is not a training log or cannot be read.
    """
    try:
        text = checked_log(log).read_text(encoding="utf-8")
        rows = csv.DictReader(io.StringIO(text)) if log.suffix == ".csv" else map(json.loads, text.splitlines())
        found = [Pass(**{name: kind(row[name]) for name, kind in Pass.__annotations__.items()}) for row in rows]
    except OSError as error:
        raise ReadError(f"{log} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ReadError(f"{log} is not a log of `cascadenorm train`") from error
    return sorted({done[:3]: done for done in found}.values())


def _lines(file: TextIO, suffix: str) -> Recorder:
    writer = csv.writer(file, lineterminator="\n")
    if suffix == ".csv" and file.tell() == 0:
        writer.writerow(Pass._fields)

    def record(done: Pass) -> None:
        if suffix == ".csv":
            writer.writerow(done)
        else:
            file.write(json.dumps(done._asdict()) + "\n")
        file.flush()

    return record


@contextmanager
def _events(folder: Path) -> Iterator[Recorder]:
    """Write curves for TensorBoard, one per figure and cluster."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise MissingDependencyError("--tensorboard", package="tensorboard") from None
    try:
        opened = SummaryWriter(str(folder))
    except OSError as error:
        raise OutputError(f"{folder} cannot be written: {error.strerror or error}") from error
    with opened as writer:

        def record(done: Pass) -> None:
            for name in ("loss", "validation", "validation_deg"):
                tag = f"stage{done.stage}/cluster{done.cluster}/{name}"
                writer.add_scalar(tag, getattr(done, name), done.epoch)

        yield record
