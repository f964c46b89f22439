"""The processes of one training, which torchrun starts, on one machine or many; each keeps a shard of the meshes."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import numpy as np
import torch
import torch.distributed.nn  # before there is a process group, since its default arguments keep the one that they find
from numpy.typing import NDArray
from torch import distributed

from cascadenorm.learned.training.launch import is_single_process
from cascadenorm.mesh import thread_count

Made = TypeVar("Made")
Value = TypeVar("Value", bound=np.generic)


@contextmanager
def process_group() -> Iterator[None]:
    """Join the processes that torchrun has started for the time of the block; a single process joins nothing."""
    if is_single_process():
        yield
        return
    distributed.init_process_group("cpu:gloo,cuda:nccl" if device().type == "cuda" else "gloo")
    try:
        yield
    finally:
        distributed.destroy_process_group()


def device() -> torch.device:
    """Return where this process does its matrix products: a GPU of its own, where there is one for each."""
    if torch.cuda.device_count() < _local_world_size():
        return torch.device("cpu")
    return torch.device("cuda", 0 if is_single_process() else int(os.environ["LOCAL_RANK"]))


def world_size() -> int:
    """Return how many processes there are."""
    return distributed.get_world_size() if distributed.is_initialized() else 1


def rank() -> int:
    """Return the place of this process among them, from 0."""
    return distributed.get_rank() if distributed.is_initialized() else 0


def cores() -> int:
    """Return how many cores there are for this process, beside the others on this machine."""
    return max(1, thread_count() // _local_world_size())


def _local_world_size() -> int:
    """Return how many processes there are on this machine, with this one."""
    return 1 if is_single_process() else int(os.environ["LOCAL_WORLD_SIZE"])


def shard() -> slice:
    """Return which items of a list belong to this process."""
    return slice(rank(), None, world_size())


def broadcast(make: Callable[[], Made]) -> Made:
    """Let the first process make something, and send it to all."""
    if world_size() == 1:
        return make()
    made = [make() if rank() == 0 else None]
    distributed.broadcast_object_list(made)
    return made[0]  # type: ignore[return-value]  # the first process has made it


def all_gather(rows: NDArray[Value]) -> NDArray[Value]:
    """Concatenate the rows of all processes, those of the first one first."""
    if world_size() == 1:
        return rows
    parts = [rows] * world_size()
    distributed.all_gather_object(parts, rows)
    return np.concatenate(parts)


def all_reduce(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Add the values of all processes."""
    if world_size() == 1:
        return values
    tensor = torch.from_numpy(np.array(values, np.float64))
    distributed.all_reduce(tensor)
    return np.asarray(tensor.numpy())


def barrier() -> None:
    """Wait until all processes are here."""
    all_reduce(np.zeros(1))
