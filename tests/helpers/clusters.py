"""Dask clusters that lose workers."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cascadenorm.batch import cluster_processes
from cascadenorm.execution import cluster

LONG_TIMEOUT_S = 600.0
"""Seconds that the tests wait for workers, since machines under load are slow.

How long they wait for an answer stays as it is: a worker that was killed after its work never gives one.
"""
CLUSTER = """
import logging, os, random, signal, sys, time
import dask
from distributed import LocalCluster
from cascadenorm.execution.cluster import LOCAL_CLUSTER_CONFIG
silent = sys.argv[1]  # how long a worker may be silent
dask.config.set({**LOCAL_CLUSTER_CONFIG, "distributed.scheduler.worker-ttl": silent})
if __name__ == "__main__":
    draw = random.Random(3)
    with LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0",
                      silence_logs=logging.CRITICAL + 1) as cluster:
        print(cluster.scheduler_address, flush=True)
        for _ in sys.stdin:  # each line kills a worker; Dask starts it again, unless it was just starting
            time.sleep(draw.uniform(0, 0.2))
            nannies, there = cluster.workers.values(), cluster.scheduler.workers
            while not (ready := [nanny.pid for nanny in nannies if nanny.pid and nanny.worker_address in there]):
                time.sleep(0.02)
            os.kill(draw.choice(ready), signal.SIGKILL)
"""


@contextmanager
def started(folder: Path, silent: str = "365 days") -> Iterator[tuple[str, subprocess.Popen]]:
    """Address and process of a scheduler with two workers, which run in a folder and may be silent for so long."""
    folder.mkdir()
    (folder / "cluster.py").write_text(CLUSTER, encoding="utf-8")
    words = [sys.executable, "cluster.py", silent]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder) as process:
        yield process.stdout.readline().strip(), process
        process.stdin.close()


@contextmanager
def patient() -> Iterator[None]:
    """Wait longer for workers."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (cluster, cluster_processes):
            patch.setattr(module, "WORKER_TIMEOUT_S", LONG_TIMEOUT_S)
        yield


def workers(pid: int) -> list[int]:
    """The worker processes that a process with a cluster has started, from whichever thread."""
    found = [int(word) for path in Path(f"/proc/{pid}/task").glob("*/children") for word in path.read_text().split()]
    return [child for child in found if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]
