"""Choice of patch sizes and processes for a memory limit."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from cascadenorm.errors import ParameterError
from cascadenorm.execution.cluster import LOCAL_CLUSTER, on_cluster
from cascadenorm.execution.memory import PROCESS_BYTES, format_bytes
from cascadenorm.geometry.patches.work import Patching, working_in_patches
from cascadenorm.mesh import thread_count
from cascadenorm.registry import Method, registered

WHOLE_FACE_BYTES = 350  # largest memory use per face of the whole mesh, including its file, during work in patches
PATCH_FACE_BYTES = 900  # the same per face of the current patch; benchmarks/speed/scale.py measures both
MIN_PATCH_FACES, MAX_PATCH_FACES = 500_000, 4_000_000
"""Limits on the faces of a patch: halos of smaller patches are too expensive, larger patches save little."""
STEPWISE_METHODS = ("auto", "cascade", "guided-normal")
"""Methods with steps that each have a small receptive field, although that of the whole method is large."""


def works_in_patches(method: Method, parameters: Mapping[str, Any]) -> bool:
    """Return whether a method with these parameters can work patch by patch, as a whole or in each of its steps."""
    given = method.with_defaults(parameters)
    return method.receptive_field(given, 1) is not None or (
        method.name in STEPWISE_METHODS and given.get("fit", "sweeps") == "sweeps"
    )


def check_works_in_patches(method: Method, parameters: Mapping[str, Any]) -> None:
    """Raise ParameterError if a method needs the whole mesh at once."""
    if works_in_patches(method, parameters):
        return
    able = [name for name, known in registered().items() if works_in_patches(known, {})]
    raise ParameterError(
        f"{method.name} needs the whole mesh at once with these parameters, and does not work in patches",
        hint=f"choose one of {', '.join(able)}, or set no limit of memory if the whole mesh fits",
    )


@contextmanager
def patches_within(memory: int, faces: int, scheduler: str | None) -> Iterator[None]:
    """Process a mesh in patches inside the block if its faces need more memory than a limit in bytes.

    The limit is for this process, or for each worker process of the scheduler: an address of Dask, or "local" for a
    cluster on this machine. Raises ParameterError if the memory is too small for the mesh, and MissingDependencyError
    or WorkerError if the cluster is not available or fails.
    """
    whole = WHOLE_FACE_BYTES * faces if scheduler is None else 0
    least = PROCESS_BYTES + whole + PATCH_FACE_BYTES * min(MIN_PATCH_FACES, faces)
    if memory < least:
        raise ParameterError(
            f"is {format_bytes(memory)}; {faces:,} faces need at least {format_bytes(least)}", parameter="memory"
        )
    left = memory - PROCESS_BYTES - whole
    size = left // PATCH_FACE_BYTES
    if scheduler is None:
        if size < faces:  # a larger patch would save little; the remaining memory caches results between passes
            size = min(MAX_PATCH_FACES, max(MIN_PATCH_FACES, size // 2))
        with working_in_patches(Patching(size, spare=left - size * PATCH_FACE_BYTES)):
            yield
        return
    workers = thread_count() if scheduler == LOCAL_CLUSTER else 1
    with (
        on_cluster(scheduler, workers=workers, folder=None) as each,
        working_in_patches(Patching(min(MAX_PATCH_FACES, size), each)),
    ):
        yield
