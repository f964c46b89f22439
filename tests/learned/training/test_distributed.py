"""Processes of one training share its meshes, cores and GPUs, and end with one model."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
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
TWO_PROCESSES = [*TORCHRUN, "-m", "--", "cascadenorm", "train"]


def trained_by_two(settings) -> Cascade:
    weights = settings.with_suffix(".safetensors")
    command = [*TWO_PROCESSES, "--config", str(settings), "-o", str(weights), "--threads", "1"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("the model is in") == 1
    return Cascade.load(weights)


def test_two_processes_share_the_meshes_and_end_with_one_model(trained, tmp_path):
    settings = tmp_path / "tiny.toml"
    settings.write_text(
        "faces_per_mesh = 500\nclusters = 2\n[fit]\nhidden = [16, 8]\nepochs = 15\nbatch = 128\n"
        '[data]\ncount = 4\nfamilies = ["smooth"]\nmin_faces = 1200\nmax_faces = 1500\n'
        'noise_kinds = ["normal"]\nmin_level = 0.15\nmax_level = 0.3\nrelief = 0.0\n'
    )
    assert read_config(settings) == TINY
    two = trained_by_two(settings)
    assert two.card["faces_trained_on"] == trained.card["faces_trained_on"]
    for f in fields(FeatureScaler):
        ours, theirs = (getattr(cascade.stages[0].scaler, f.name) for cascade in (two, trained))
        np.testing.assert_allclose(ours, theirs, atol=1e-4)
    clean = icosphere(3)
    mesh = noisy(clean, 0.15, seed=5)
    assert mean_angle(mesh.moved(two.vertices(mesh)), clean) < 0.6 * mean_angle(mesh, clean)


def test_a_process_may_have_no_face_of_a_cluster(tmp_path):
    settings = tmp_path / "tiny.toml"
    settings.write_text(
        'faces_per_mesh = 40\nclusters = 30\n[[stages]]\ndescriptor = "B"\n[fit]\nhidden = [4]\nepochs = 2\n'
        '[data]\ncount = 2\nfamilies = ["smooth"]\nmin_faces = 1200\nmax_faces = 1500\n'
    )
    assert trained_by_two(settings).card["faces_trained_on"] == 80


SECOND_WAITS_FOR_THE_LOG = """
import os, sys, time
from pathlib import Path
from cascadenorm.cli import main
if __name__ == "__main__":
    while os.environ["RANK"] == "1" and not Path(sys.argv[-1]).exists():
        time.sleep(0.05)
    main(sys.argv[1:])
"""


def test_the_log_that_rank_0_has_begun_is_no_reason_for_the_others_to_stop(tmp_path):
    (tmp_path / "second_waits.py").write_text(SECOND_WAITS_FOR_THE_LOG)
    (tmp_path / "tiny.toml").write_text(
        'faces_per_mesh = 40\n[[stages]]\ndescriptor = "B"\n[fit]\nhidden = [4]\nepochs = 2\n'
        '[data]\ncount = 2\nfamilies = ["smooth"]\nmin_faces = 1200\nmax_faces = 1500\n'
    )
    words = ["train", "--config", "tiny.toml", "-o", "tiny.safetensors", "--threads", "1", "--log", "log.csv"]
    done = subprocess.run([*TORCHRUN, "--", "second_waits.py", *words], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [one.epoch for one in read_passes(tmp_path / "log.csv")] == [1, 2]


THREADS_LEFT = """
import gc
import sys
from pathlib import Path
import torch
from cascadenorm.learned.training import distributed
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
sys.exit(any("gloo" in name for name in names))
"""


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are listed in /proc on Linux alone")
def test_a_process_group_leaves_no_thread_that_could_abort_the_end_of_a_process(tmp_path):
    (tmp_path / "ends.py").write_text(THREADS_LEFT)
    done = subprocess.run([*TORCHRUN, str(tmp_path / "ends.py")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_fewer_meshes_than_processes_are_refused_in_words(tmp_path):
    (tmp_path / "one.toml").write_text("[data]\ncount = 1\n")
    command = [*TWO_PROCESSES, "--config", str(tmp_path / "one.toml"), "-o", str(tmp_path / "one.safetensors")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode and "2 processes are more than the meshes, 1: take fewer" in done.stderr


@pytest.mark.parametrize(("count", "expected"), [(0, "cpu"), (1, "cpu"), (2, "cuda:1")])
def test_each_process_has_a_gpu_of_its_own_or_none_has_one(monkeypatch, count, expected):
    for name, value in {"WORLD_SIZE": "4", "LOCAL_WORLD_SIZE": "2", "LOCAL_RANK": "1", "RANK": "3"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
    assert distributed.device() == torch.device(expected)
    with ThreadPoolExecutor(1) as pool:  # networks are trained in threads, which do not know of one another's GPU
        assert pool.submit(distributed.device).result() == torch.device(expected)
