"""How large patches may be for the memory that is given, and which processes work on them."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from cascadenorm.errors import ParameterError
from cascadenorm.execution.cluster import LOCAL_CLUSTER
from cascadenorm.execution.cluster_map import on_cluster
from cascadenorm.execution.memory import PROCESS, amount
from cascadenorm.mesh import thread_count
from cascadenorm.patches.work import Patching, working_in_patches
from cascadenorm.registry import Method, registered

WHOLE = 350
"""Bytes a face that the whole mesh takes at most, with its file, while work is done in patches."""
PATCH = 900
"""Bytes that each face of a patch takes at most while it is worked on; benchmarks/speed/patches.py measures both."""
SMALLEST, LARGEST = 500_000, 4_000_000
"""Faces of a patch: halos of smaller ones cost more than the patches, larger ones save little."""
IN_STEPS = ("auto", "cascade", "guided-normal")
"""Methods whose steps see little of the mesh, all of them together most of it."""


def works_in_patches(method: Method, parameters: Mapping[str, Any]) -> bool:
    """Whether a method with these parameters works on a patch at a time, or needs little memory for the whole."""
    given = method.with_defaults(parameters)
    return method.receptive_field(given, 1) is not None or (
        method.name in IN_STEPS and given.get("fit", "sweeps") == "sweeps"
    )


def check_works_in_patches(method: Method, parameters: Mapping[str, Any]) -> None:
    """Raise ParameterError for a method that needs the whole mesh at once."""
    if works_in_patches(method, parameters):
        return
    able = [name for name, known in registered().items() if works_in_patches(known, {})]
    raise ParameterError(
        f"{method.name} needs the whole mesh at once with these parameters, and does not work in patches",
        hint=f"choose one of {', '.join(able)}, or denoise without memory where the whole fits",
    )


@contextmanager
def patches_within(memory: int, faces: int, scheduler: str | None) -> Iterator[None]:
    """Let work inside the block be done in patches where the whole mesh needs more memory than is given.

    Parameters
    ----------
    memory
        Bytes for this process; with a scheduler those of each worker process.
    faces
        Number of faces of the mesh.
    scheduler
        Address of the Dask scheduler whose workers work on the patches, "local" for a cluster on this machine, or None
        for this process.

    Raises
    ------
    ParameterError
        The memory is too small for the mesh.
    MissingDependencyError, WorkerError
        Of the cluster.
    """
    whole = WHOLE * faces if scheduler is None else 0
    left = memory - PROCESS - whole
    if left < PATCH * min(SMALLEST, faces):
        least = PROCESS + whole + PATCH * min(SMALLEST, faces)
        raise ParameterError(f"is {amount(memory)}; {faces:,} faces need at least {amount(least)}", parameter="memory")
    if scheduler is None:
        # without a halo a patch of LARGEST faces saves little, and what is left keeps results between passes
        size = left // PATCH if left >= PATCH * faces else min(LARGEST, max(SMALLEST, left // 2 // PATCH))
        with working_in_patches(Patching(size, spare=left - size * PATCH)):
            yield
        return
    workers = thread_count() if scheduler == LOCAL_CLUSTER else 1
    with (
        on_cluster(scheduler, workers=workers, folder=None) as each,
        working_in_patches(Patching(min(LARGEST, left // PATCH), each)),
    ):
        yield
