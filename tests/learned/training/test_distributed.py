"""Processes of one training share its meshes, cores and GPUs, and end with one model."""

import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import torch
from shapes import icosphere, mean_angle, noisy
from trainings import TINY

from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.config import read_config
from cascadenorm.learned.features import FeatureScaler
from cascadenorm.learned.training import distributed
from cascadenorm.learned.training.training_log import read_passes

TORCHRUN = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2"]
TINY_SETTINGS = """
faces_per_mesh = 500
clusters = 2
[fit]
hidden = [16, 8]
epochs = 15
batch = 128
[data]
count = 4
families = ["smooth"]
min_faces = 1200
max_faces = 1500
noise_kinds = ["normal"]
min_level = 0.15
max_level = 0.3
relief = 0.0
"""
FEW_FACES = """
faces_per_mesh = 40
clusters = 30
[[stages]]
descriptor = "B"
[fit]
hidden = [4]
epochs = 2
[data]
count = 2
families = ["smooth"]
min_faces = 1200
max_faces = 1500
"""
ONE_MESH = """
[data]
count = 1
"""
IN_EACH_PROCESS = """
import gc, os, sys, time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
import torch
from cascadenorm.cli import run
from cascadenorm.learned.training import distributed

rank, ports = os.environ["RANK"], iter(sys.argv[1:])
os.environ["TORCHELASTIC_USE_AGENT_STORE"] = "False"  # groups that follow one another need a store each


def names_of_threads():
    os.environ["MASTER_PORT"] = next(ports)
    gc.disable()
    with distributed.process_group():
        weights = torch.nn.Linear(3, 1)
        network = torch.nn.parallel.DistributedDataParallel(weights)
        optimiser = torch.optim.AdamW(network.parameters())
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, 1)  # each refers to the other
        network(torch.ones(2, 3)).sum().backward()
        optimiser.step()
        del weights, network, optimiser, schedule
    names = [thread.read_text() for thread in Path("/proc/self/task").glob("*/comm")]
    gc.enable()
    return names


def train(name, *words, succeeds=True):
    os.environ["MASTER_PORT"] = next(ports)
    words = ["train", "--config", f"{name}.toml", "-o", f"{name}.safetensors", "--threads", "1", *words]
    with open(f"{name}.out{rank}", "w") as out, open(f"{name}.err{rank}", "w") as err:
        with redirect_stdout(out), redirect_stderr(err):
            code = run(words)
    if (code == 0) != succeeds:
        sys.exit(f"{name}: exit code {code}: " + Path(f"{name}.err{rank}").read_text())


if __name__ == "__main__":
    Path(f"threads{rank}").write_text("".join(names_of_threads()))
    while rank == "1" and not Path("log.csv").exists():
        time.sleep(0.05)
    train("tiny", "--log", "log.csv")
    train("few_faces")
    train("one_mesh", succeeds=False)
"""


def free_ports(count: int) -> list[str]:
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(count)]
        return [str(one.getsockname()[1]) for one in sockets]


@pytest.fixture(scope="module")
def two_processes(tmp_path_factory) -> Path:
    """The folder where two processes have been; a launch takes seconds, so that one shows all."""
    folder = tmp_path_factory.mktemp("two")
    for name, settings in {"tiny": TINY_SETTINGS, "few_faces": FEW_FACES, "one_mesh": ONE_MESH}.items():
        (folder / f"{name}.toml").write_text(settings)
    (folder / "script.py").write_text(IN_EACH_PROCESS)
    command = [*TORCHRUN, "script.py", *free_ports(4)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def said(folder: Path, name: str) -> str:
    """What both processes have written to standard output."""
    return "".join((folder / f"{name}.out{rank}").read_text() for rank in range(2))


def test_two_processes_share_the_meshes_and_end_with_one_model(trained, two_processes):
    assert read_config(two_processes / "tiny.toml") == TINY
    assert said(two_processes, "tiny").count("the model is in") == 1
    two = Cascade.load(two_processes / "tiny.safetensors")
    assert two.card["faces_trained_on"] == trained.card["faces_trained_on"]
    for f in fields(FeatureScaler):
        ours, theirs = (getattr(cascade.stages[0].scaler, f.name) for cascade in (two, trained))
        np.testing.assert_allclose(ours, theirs, atol=1e-4)
    clean = icosphere(3)
    mesh = noisy(clean, 0.15, seed=5)
    assert mean_angle(mesh.moved(two.vertices(mesh)), clean) < 0.6 * mean_angle(mesh, clean)


def test_the_log_that_rank_0_has_begun_is_no_reason_for_the_others_to_stop(two_processes):
    assert [(one.stage, one.cluster, one.epoch) for one in read_passes(two_processes / "log.csv")] == [
        (number, cluster, epoch)
        for number, stage in enumerate(TINY.stages, 1)
        for cluster in (1, 2)
        for epoch in range(1, (stage.epochs or TINY.fit.epochs) + 1)
    ]


def test_a_process_may_have_no_face_of_a_cluster(two_processes):
    assert said(two_processes, "few_faces").count("the model is in") == 1
    assert Cascade.load(two_processes / "few_faces.safetensors").card["faces_trained_on"] == 80


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are listed in /proc on Linux alone")
def test_a_process_group_leaves_no_thread_that_could_abort_the_end_of_a_process(two_processes):
    for rank in range(2):
        names = (two_processes / f"threads{rank}").read_text().splitlines()
        assert names and not [name for name in names if "gloo" in name]


def test_fewer_meshes_than_processes_are_refused_in_words(two_processes):
    errors = [(two_processes / f"one_mesh.err{rank}").read_text() for rank in range(2)]
    assert any("2 processes are more than the meshes, 1: take fewer" in error for error in errors)


@pytest.mark.slow  # two more processes that import torch
def test_the_module_is_started_by_torchrun(tmp_path):
    (tmp_path / "few_faces.toml").write_text(FEW_FACES)
    words = ["train", "--config", "few_faces.toml", "-o", "few_faces.safetensors", "--threads", "1"]
    command = [*TORCHRUN, "-m", "--", "cascadenorm", *words]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("the model is in") == 1


@pytest.mark.parametrize(("count", "expected"), [(0, "cpu"), (1, "cpu"), (2, "cuda:1")])
def test_each_process_has_a_gpu_of_its_own_or_none_has_one(monkeypatch, count, expected):
    for name, value in {"WORLD_SIZE": "4", "LOCAL_WORLD_SIZE": "2", "LOCAL_RANK": "1", "RANK": "3"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
    assert distributed.device() == torch.device(expected)
    with ThreadPoolExecutor(1) as pool:  # networks are trained in threads, which do not know of one another's GPU
        assert pool.submit(distributed.device).result() == torch.device(expected)
