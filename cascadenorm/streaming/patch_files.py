"""A file for each patch, written by this process or by the workers of a cluster."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from cascadenorm.errors import WorkerError
from cascadenorm.execution.process_map import Map
from cascadenorm.io.atomic import write_atomically


def write_missing(paths: Sequence[Path], content_of: Callable[[int], bytes], each: Map) -> Iterator[int]:
    """Write the files that are not there yet; yield how many there are, each time there is another.

    Parameters
    ----------
    paths : of the files of all patches
    content_of : returns the content of the file of a patch, by its number; the same each time, as a cluster does work
        again when a worker is lost
    each : does the work
    """
    missing = [item for item in enumerate(paths) if not item[1].exists()]
    there = len(paths) - len(missing)
    if there:
        yield there
    for done, _ in enumerate(each(partial(_write, content_of), missing), 1):
        yield there + done


def _write(content_of: Callable[[int], bytes], item: tuple[int, Path]) -> None:
    number, path = item
    if not path.parent.is_dir():
        raise WorkerError(
            f"a worker does not find {path.parent}",
            hint="the folder of the output has to have the same name on all machines of the cluster",
        )
    write_atomically(path, [content_of(number)], force=True)
