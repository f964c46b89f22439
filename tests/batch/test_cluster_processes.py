"""Batches on a Dask cluster: what processes of one machine do, whatever happens to the workers."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest
from batches import FAST, LINUX, done_so_far, lines, results, scans
from clusters import started, workers

from cascadenorm.batch import cluster_processes
from cascadenorm.batch.batch import denoise_files
from cascadenorm.cli import run
from cascadenorm.errors import WorkerError

LocalCluster = pytest.importorskip("distributed").LocalCluster


def of_batch(folder: Path) -> dict[str, object]:
    """What the manifest says of each file, but when and how long it took."""
    done = lines(folder, "done")
    assert len({line["output"] for line in done}) == len(done), "something was done twice"
    for line in done:
        del line["attempts"], line["seconds"], line["time"], line["summary"]["seconds"], line["summary"]["output"]
    return {line["output"]: line for line in done}


@LINUX
@pytest.mark.parametrize("kills", [(2,), pytest.param((4, 12, 20, 30), marks=pytest.mark.slow)], ids=len)
def test_workers_killed_at_random_moments_change_no_byte_and_nothing_is_done_twice(place, cluster, kills):
    address, scheduler = cluster
    count, left = kills[-1] + 10, list(kills)
    scans(place / "scans", count)
    (place / "scans" / "a" / "bad.ply").write_text("ply\nno more", encoding="ascii")

    def kill(_: float) -> None:
        if left and done_so_far(place / "out") >= left[0]:
            del left[0]
            scheduler.stdin.write("\n")
            scheduler.stdin.flush()

    settings = {"method": "laplacian", "progress": kill, "retries": 9}
    killed = denoise_files([place / "scans"], place / "out", scheduler=address, **settings)
    assert not left
    here = denoise_files([place / "scans"], place / "undisturbed", workers=1, method="laplacian")
    for found in (killed, here):
        assert [failure.source for failure in found.failures] == [str(place / "scans" / "a" / "bad.ply")]
    assert len(results(place / "out")) == count
    assert results(place / "out") == results(place / "undisturbed")
    assert of_batch(place / "out") == of_batch(place / "undisturbed")


@LINUX
@pytest.mark.slow  # it waits for the scheduler to give the worker up
def test_a_worker_that_hangs_is_given_up_and_its_file_tried_again(place):
    scans(place / "scans", 6)
    with started(place / "cluster", "30 s") as (address, process):
        os.kill(workers(process.pid)[0], signal.SIGSTOP)
        found = denoise_files([place / "scans"], place / "out", method="taubin", scheduler=address, retries=3)
        for worker in workers(process.pid):
            os.kill(worker, signal.SIGCONT)
    assert len(found.lines) == 6 and not found.failures
    assert len(of_batch(place / "out")) == 6


@pytest.mark.slow  # a worker is started again
def test_work_that_takes_too_long_is_stopped_and_its_worker_restarted(place, cluster):
    scans(place / "scans", 1)
    late = denoise_files(place / "scans", place / "out", method="taubin", scheduler=cluster[0], timeout=1e-4, retries=0)
    assert [str(failure.error) for failure in late.failures] == ["it took longer than 0.0001 seconds, and was stopped"]
    found = denoise_files(place / "scans", place / "out", method="taubin", scheduler=cluster[0], retries=5)
    assert len(found.lines) == 1 and not found.failures


def test_a_batch_goes_on_where_another_has_ended(place, cluster):
    scans(place / "scans", 4)
    source, out = str(place / "scans"), place / "out"
    here = ["batch", "scans", "-o", "out", "--method", "taubin", "--scheduler", "local", "--workers", "1"]
    assert run(here) == 0
    again = denoise_files(source, out, method="taubin", scheduler=cluster[0], workers=1)
    assert len(again.kept) == 4 and not again.lines
    other = denoise_files(source, out, method="taubin", parameters={"iterations": 3}, scheduler=cluster[0])
    assert len(other.lines) == 4 and not other.failures


def test_workers_that_cannot_do_the_work_are_named(place, cluster, monkeypatch):
    scans(place / "scans", 1)
    with pytest.raises(WorkerError, match=r"runs in .*, so relative paths refer to other files there: use absolute"):
        denoise_files("scans", "out", method="taubin", scheduler=cluster[0])
    mask = place / "mask.npy"
    np.save(mask, np.ones(162))
    with pytest.raises(WorkerError, match="relative paths"):
        denoise_files([place / "scans"], place / "out", method="taubin", scheduler=cluster[0], mask="mask.npy")
    monkeypatch.setattr(cluster_processes, "__version__", "0.0.1")
    with pytest.raises(WorkerError, match=r"it has cascadenorm .*, but this process has 0\.0\.1"):
        denoise_files([place / "scans"], place / "out", method="taubin", scheduler=cluster[0])


def test_an_address_without_a_scheduler_is_refused(place, capsys, monkeypatch):
    import dask

    scans(place / "scans", 1)
    with dask.config.set({"distributed.comm.timeouts.connect": 1}):
        assert run(["batch", "scans", "-o", "out", *FAST, "--scheduler", "127.0.0.1:9"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("cascadenorm: --scheduler is '127.0.0.1:9', where no Dask scheduler answers: ")
    assert said.count("\n") == 1 and not (place / "out").exists()


def test_workers_may_join_and_leave_and_a_batch_without_any_ends(place, monkeypatch):
    scans(place / "scans", 4)
    source, out = place / "scans", place / "out"
    left = []

    def leave(fraction: float) -> None:
        if not left:
            left.append(fraction)
            cluster.scale(2)
            cluster.sync(cluster.workers[0].close, executor_wait=False)

    options = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(**options) as cluster:
        address = cluster.scheduler_address
        found = denoise_files(source, out, method="laplacian", scheduler=address, progress=leave, retries=3)
        assert left and len(found.lines) == 4 and not found.failures
        assert len(of_batch(out)) == 4
        monkeypatch.setattr(cluster_processes, "WORKER_TIMEOUT_S", 1.0)
        with pytest.raises(WorkerError, match="has had no worker for 1 seconds"):  # none of these has a nanny
            denoise_files(source, out, method="taubin", scheduler=address, timeout=1e-4, retries=5)
