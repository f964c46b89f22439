"""The processes of one training, which torchrun starts, on one machine or many; each keeps its share of the meshes."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import distributed

from cascadenorm.learned.launch import alone
from cascadenorm.mesh import thread_count

Made = TypeVar("Made")
Value = TypeVar("Value", bound=np.generic)


@contextmanager
def together() -> Iterator[None]:
    """Join the processes that torchrun has started for the time of the block; a process started alone stays alone."""
    if alone():
        yield
        return
    distributed.init_process_group("cpu:gloo,cuda:nccl" if device().type == "cuda" else "gloo")
    try:
        yield
    finally:
        distributed.destroy_process_group()


def device() -> torch.device:
    """Return where this process does its matrix products: a GPU of its own, where there is one for each."""
    if torch.cuda.device_count() < _beside():
        return torch.device("cpu")
    return torch.device("cuda", 0 if alone() else int(os.environ["LOCAL_RANK"]))


def count() -> int:
    """Return how many processes there are."""
    return distributed.get_world_size() if distributed.is_initialized() else 1


def rank() -> int:
    """Return the place of this process among them, from 0."""
    return distributed.get_rank() if distributed.is_initialized() else 0


def cores() -> int:
    """Return how many cores there are for this process, beside the others on this machine."""
    return max(1, thread_count() // _beside())


def _beside() -> int:
    """Return how many processes there are on this machine, with this one."""
    return 1 if alone() else int(os.environ["LOCAL_WORLD_SIZE"])


def share() -> slice:
    """Return which of a list of things are this process's own."""
    return slice(rank(), None, count())


def from_first(make: Callable[[], Made]) -> Made:
    """Let the first process make something, and give it to all."""
    if count() == 1:
        return make()
    made = [make() if rank() == 0 else None]
    distributed.broadcast_object_list(made)
    return made[0]  # type: ignore[return-value]  # the first process has made it


def gathered(rows: NDArray[Value]) -> NDArray[Value]:
    """Put the rows of all processes together, those of the first one first."""
    if count() == 1:
        return rows
    parts = [rows] * count()
    distributed.all_gather_object(parts, rows)
    return np.concatenate(parts)


def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Add the values of all processes."""
    if count() == 1:
        return values
    tensor = torch.from_numpy(np.array(values, np.float64))
    distributed.all_reduce(tensor)
    return np.asarray(tensor.numpy())


def meet() -> None:
    """Wait until all processes are here."""
    total(np.zeros(1))
