"""Data and evaluations made on a Dask cluster: what this machine makes, whatever happens to the workers."""

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from batches import LINUX, START, children, results, running, wait_for
from shapes import icosphere, noisy

from cascadenorm.api.training_pairs import write_pairs
from cascadenorm.cli import run
from cascadenorm.errors import ParameterError, WorkerError
from cascadenorm.evaluation.harness import evaluate
from cascadenorm.execution import cluster as dask_cluster
from cascadenorm.execution.cluster import dask_client, on_cluster
from cascadenorm.io.interop import save_mesh

distributed = pytest.importorskip("distributed")
LocalCluster = distributed.LocalCluster
BALL = icosphere(2)


def killing(process: subprocess.Popen, *moments: int):
    """A progress that kills a worker after so many parts."""
    left = list(moments)

    def progress(task: str, done: int, total: int, *_: str) -> None:
        if left and done >= left[0]:
            left.pop(0)
            process.stdin.write("\n")
            process.stdin.flush()

    progress.left = left
    return progress


def pairs(folder: Path, count: int) -> Path:
    for number in range(count):
        place = folder / f"ball{number}"
        place.mkdir(parents=True)
        save_mesh(place / "clean.ply", BALL)
        save_mesh(place / "noisy.ply", noisy(BALL, 0.2, seed=number))
    return folder


@LINUX
@pytest.mark.parametrize(
    ("count", "kills"),
    [
        pytest.param(1, [], id="never"),
        pytest.param(3, [1], id="once", marks=pytest.mark.slow),  # each new worker loads all that makes shapes
        pytest.param(5, [1, 3], id="twice", marks=pytest.mark.slow),
    ],
)
def test_pairs_are_generated_to_the_same_bytes_when_workers_are_killed(tmp_path, cluster, count, kills):
    address, process = cluster
    progress = killing(process, *kills)
    write_pairs(tmp_path / "killed", count=count, seed=10, scheduler=address, progress=progress)
    assert not progress.left
    write_pairs(tmp_path / "undisturbed", count=count, seed=10)
    assert len(results(tmp_path / "killed")) == 2 * count + 1
    assert results(tmp_path / "killed") == results(tmp_path / "undisturbed")


@LINUX
@pytest.mark.parametrize(
    ("count", "kills"), [(4, [2]), pytest.param(8, [2, 9, 16], marks=pytest.mark.slow)], ids=["once", "often"]
)
def test_methods_are_measured_alike_when_workers_are_killed(tmp_path, cluster, count, kills):
    address, process = cluster
    folder, settings = pairs(tmp_path / "pairs", count), {"methods": ("taubin", "bilateral-normal")}
    (folder / "ball3" / "noisy.ply").write_text("ply\nno more", encoding="ascii")
    progress = killing(process, *kills)
    killed = evaluate(folder, keep=tmp_path / "killed", scheduler=address, progress=progress, **settings)
    here = evaluate(folder, keep=tmp_path / "undisturbed", **settings)
    assert not progress.left and len(here.results) == 3 * (count - 1)
    assert [(one.pair, one.method, one.measures) for one in killed.results] == [
        (one.pair, one.method, one.measures) for one in here.results
    ]
    assert [(one.pair, str(one.error)) for one in killed.failures] == [
        (one.pair, str(one.error)) for one in here.failures
    ]
    meshes = [
        {name: data for name, data in results(tmp_path / kept).items() if name.endswith(".ply")}
        for kept in ("killed", "undisturbed")
    ]
    assert meshes[0] == meshes[1] and len(meshes[0]) == 3 * (count - 1)


def test_results_come_in_order_and_an_error_where_its_result_is_asked_for(cluster):
    with on_cluster(cluster[0], workers=1, folder=None) as each:
        assert list(each(math.sqrt, [n * n for n in range(30)])) == list(range(30))
        found = each(math.sqrt, [4, -1, 9])
        assert next(found) == 2
        with pytest.raises(ValueError, match="math domain error"):
            next(found)


@pytest.mark.slow  # four workers have to be started again
def test_work_that_ends_every_worker_is_given_up(cluster):
    with (
        pytest.raises(WorkerError, match="memory may be short"),
        on_cluster(cluster[0], workers=1, folder=None) as each,
    ):
        list(each(os._exit, [1]))


def test_workers_that_cannot_do_the_work_are_named(tmp_path, cluster, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pairs(tmp_path / "pairs", 1)
    with pytest.raises(WorkerError, match=r"runs in .*, so relative paths refer to other files there: use absolute"):
        evaluate("pairs", methods="taubin", scheduler=cluster[0])
    with pytest.raises(ParameterError, match="keep must be a folder that all workers see"):
        evaluate("pairs", methods="taubin", noise=0.1, scheduler=cluster[0])
    with pytest.raises(ParameterError, match=r"workers is 2; at .* all workers of the cluster work: leave it out"):
        evaluate("pairs", methods="taubin", workers=2, scheduler=cluster[0])
    monkeypatch.setattr(dask_cluster, "__version__", "0.0.1")
    with pytest.raises(WorkerError, match=r"has cascadenorm .*, but this process has 0\.0\.1"):
        write_pairs(tmp_path / "out", count=1, seed=0, scheduler=cluster[0])


def test_a_cluster_without_workers_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_cluster, "WORKER_TIMEOUT_S", 1.0)
    options = {"n_workers": 0, "processes": False, "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(**options) as empty, pytest.raises(WorkerError, match="has had no worker for 1 seconds"):
        write_pairs(tmp_path / "out", count=1, seed=0, scheduler=empty.scheduler_address)


@pytest.mark.parametrize("words", [["generate", "out"], ["evaluate", "pairs", "--method", "taubin"]])
def test_an_address_without_a_scheduler_and_a_missing_extra_are_one_line(tmp_path, capsys, monkeypatch, words):
    import dask

    monkeypatch.chdir(tmp_path)
    pairs(tmp_path / "pairs", 1)
    with dask.config.set({"distributed.comm.timeouts.connect": 1}):
        assert run([*words, "--scheduler", "127.0.0.1:9"]) == 2
        assert run([*words, "--scheduler", "tls://127.0.0.1:9"]) == 2  # without a certificate in Dask's configuration
    said = capsys.readouterr().err.splitlines()
    assert "scheduler is '127.0.0.1:9', where no Dask scheduler answers: " in said[0] and len(said) == 2
    assert "scheduler is 'tls://127.0.0.1:9', where no Dask scheduler answers: " in said[1]
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run([*words, "--scheduler", "local"]) == 1
    said = capsys.readouterr().err
    assert 'pip install "cascadenorm[cluster]"' in said and len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("stalls", [1, dask_cluster.START_ATTEMPTS])
def test_a_machine_too_busy_to_start_dask_is_tried_again(cluster, monkeypatch, stalls):
    """A client of Dask fails with a bare AssertionError where its thread does not begin within 10 s."""
    client, left = distributed.Client, [None] * stalls

    def stalling(*args, **options):
        assert not left or left.pop()
        return client(*args, **options)

    monkeypatch.setattr(distributed, "Client", stalling)
    if stalls < dask_cluster.START_ATTEMPTS:
        with on_cluster(cluster[0], workers=1, folder=None) as each:
            assert list(each(abs, [-1])) == [1]
    else:
        with (
            pytest.raises(WorkerError, match="Dask did not start: the machine is too busy"),
            on_cluster(cluster[0], workers=1, folder=None),
        ):
            pass


@LINUX
@pytest.mark.slow  # a worker loads all that makes shapes
def test_ctrl_c_ends_a_cluster_of_this_machine(tmp_path):
    command = [
        sys.executable,
        "-c",
        START,
        "generate",
        "out",
        "--count",
        "60",
        "--scheduler",
        "local",
        "--workers",
        "1",
    ]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        wait_for(lambda: (tmp_path / "out").exists() and any((tmp_path / "out").iterdir()), process)
        workers = children(process.pid)
        assert workers
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate()
    assert process.returncode == 130 and said == "cascadenorm: interrupted; no file was left half written\n"
    wait_for(lambda: not any(map(running, workers)))


@LINUX
@pytest.mark.slow  # it waits for the moment at which Dask looks whether a lost worker has come back
def test_a_worker_that_is_lost_twice_is_restarted_twice():
    with dask_client("local", workers=1, threads=1, memory=2**30) as client:

        def kill() -> None:
            (process,) = client.run(os.getpid).values()
            os.kill(process, signal.SIGKILL)

        kill()
        time.sleep(5)
        client.wait_for_workers(1)
        time.sleep(9.6)
        kill()
        time.sleep(1)
        client.wait_for_workers(1)
        assert client.submit(sum, [1, 2], pure=False).result() == 3
