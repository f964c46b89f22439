"""The processes of a training that torchrun starts, on one or more machines.

Each process keeps a shard of the meshes.
"""

import gc
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import numpy as np
import torch
import torch.distributed.nn  # import before a process group exists: its default arguments keep the group they find
from numpy.typing import NDArray
from torch import distributed

from cascadenorm.learned.training.launch import is_single_process
from cascadenorm.mesh import Floats, thread_count

Made = TypeVar("Made")
Value = TypeVar("Value", bound=np.generic)


@contextmanager
def process_group() -> Iterator[None]:
    """Join the processes started by torchrun for the duration of the block. A single process joins nothing."""
    if is_single_process():
        yield
        return
    distributed.init_process_group("cpu:gloo,cuda:nccl" if device().type == "cuda" else "gloo")
    try:
        yield
    finally:
        # Models that torch left in reference cycles keep the group alive, and its threads would abort the process when
        # the interpreter ends.
        gc.collect()
        distributed.destroy_process_group()


def device() -> torch.device:
    """Return the device for matrix products: a GPU if there is one for each process, else the CPU."""
    if torch.cuda.device_count() < _local_world_size():
        return torch.device("cpu")
    return torch.device("cuda", 0 if is_single_process() else int(os.environ["LOCAL_RANK"]))


def world_size() -> int:
    return distributed.get_world_size() if distributed.is_initialized() else 1


def rank() -> int:
    """Return the rank of this process, counted from 0."""
    return distributed.get_rank() if distributed.is_initialized() else 0


def cores() -> int:
    """Return the number of cores for this process, given the other processes on this machine."""
    return max(1, thread_count() // _local_world_size())


def _local_world_size() -> int:
    return 1 if is_single_process() else int(os.environ["LOCAL_WORLD_SIZE"])


def broadcast(make: Callable[[], Made]) -> Made:
    """Call a function on rank 0 and send the result to all processes."""
    if world_size() == 1:
        return make()
    made = [make() if rank() == 0 else None]
    distributed.broadcast_object_list(made)
    return made[0]  # type: ignore[return-value]  # the first process has made it


def all_gather(rows: NDArray[Value]) -> NDArray[Value]:
    """Concatenate the rows of all processes, in the order of their ranks."""
    if world_size() == 1:
        return rows
    parts = [rows] * world_size()
    distributed.all_gather_object(parts, rows)
    return np.concatenate(parts)


def all_reduce(values: Floats) -> Floats:
    """Add the values of all processes."""
    if world_size() == 1:
        return values
    tensor = torch.from_numpy(np.array(values, np.float64))
    distributed.all_reduce(tensor)
    return np.asarray(tensor.numpy())


def barrier() -> None:
    all_reduce(np.zeros(1))
