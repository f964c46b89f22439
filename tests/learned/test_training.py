import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from shapes import cube, icosphere, mean_angle, noisy

from cascadenorm.data_gen import DatasetConfig, pairs
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.config import ConfigError, Fit, TrainConfig, read_config
from cascadenorm.learned.descriptors import DESCRIPTORS, bilateral_descriptor
from cascadenorm.learned.features import FeatureScaler, all_pairs
from cascadenorm.learned.packed_normals import unpacked
from cascadenorm.learned.regression import stage_stack
from cascadenorm.learned.stage import Stage
from cascadenorm.learned.training import checkpoints, distributed, training
from cascadenorm.learned.training.launch import is_local_main, is_main
from cascadenorm.learned.training.network_training import (
    TrainingFaces,
    angle_sum,
    chordal_distance,
    torch_features,
    train_network,
)
from cascadenorm.learned.training.training import informative_pairs, train_cascade
from cascadenorm.learned.training.training_log import read_passes
from cascadenorm.mesh import limit_threads, unit

TORCHRUN = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2"]
TWO_PROCESSES = [*TORCHRUN, "-m", "--", "cascadenorm", "train"]
STAGE = '[[stages]]\ndescriptor = "B"\n'
TINY = TrainConfig(
    faces_per_mesh=500,
    clusters=2,
    fit=Fit(hidden=(16, 8), epochs=15, batch=128),
    data=DatasetConfig(
        count=4,
        families=("smooth",),
        min_faces=1200,
        max_faces=1500,
        noise_kinds=("normal",),
        min_level=0.15,
        max_level=0.3,
    ),
)


class Interrupted(Exception):
    pass


def interrupt_at(task: str, done: int):
    def progress(now: str, count: int, total: int, note: str = "") -> None:
        if now == task and count == done:
            raise Interrupted

    return progress


@pytest.fixture(autouse=True, scope="module")
def in_this_process():
    with limit_threads(1):
        yield


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    return train_cascade(TINY, tmp_path_factory.mktemp("tiny"))


def to_learn_from(clean, level) -> tuple[TrainingFaces, FeatureScaler]:
    """All faces of a mesh with noise, and a scaler that leaves their features as they are."""
    stack = bilateral_descriptor(noisy(clean, level))
    pairs = all_pairs(stack.shape[1])
    inputs = len(pairs)
    zero, one, none = np.zeros(inputs, np.float32), np.ones(inputs, np.float32), np.zeros(0, np.float32)
    scaler = FeatureScaler(
        pairs=pairs,
        mean=zero,
        scale=one,
        projection=np.zeros((inputs, 0), np.float32),
        context_mean=none,
        context_scale=none,
    )
    context = np.zeros((len(stack), 0), np.float32)
    return TrainingFaces(*map(torch.from_numpy, (stack, context, clean.face_normals.astype(np.float32)))), scaler


def test_training_lowers_the_loss():
    faces, scaler = to_learn_from(cube(10), 0.25)
    losses: list[float] = []
    rows, fit = np.arange(len(faces.truth)), Fit(epochs=8, batch=64)
    train_network(faces, rows, scaler, fit, "tanh", seed=0, log=lambda *said: losses.append(said[2]))
    assert losses[-1] < 0.95 * losses[0]


def test_features_to_learn_from_are_those_at_run_time():
    mesh = noisy(icosphere(2), 0.3)
    packed = stage_stack(Stage(descriptor="B"), mesh, mesh)
    stack, rng = unpacked(packed), np.random.default_rng(0)
    pairs = all_pairs(10)[::2]
    mean, scale, context_mean, context_scale = (rng.uniform(0.5, 2, n).astype(np.float32) for n in (23, 23, 11, 11))
    scaler = FeatureScaler(
        pairs=pairs, mean=mean, scale=scale, projection=rng.normal(size=(23, 2)).astype(np.float32),
        context_mean=context_mean, context_scale=context_scale,
    )  # fmt: skip
    context = scaler.context(packed, mesh).of()
    learned = torch_features(scaler, torch.device("cpu"))(torch.from_numpy(stack), torch.from_numpy(context))
    np.testing.assert_allclose(learned, scaler.features(stack, context), rtol=0, atol=1e-5)


def test_pairs_that_show_how_far_normals_are_from_the_true_one_are_chosen():
    stack = unit(np.random.default_rng(0).normal(size=(500, 6, 3))).astype(np.float32)
    found = informative_pairs(stack, stack[:, 2], 5)
    np.testing.assert_array_equal(found, [[0, 2], [1, 2], [2, 3], [2, 4], [2, 5]])


def test_a_stage_reads_only_as_many_pairs_as_it_declares(tmp_path):
    stages = (Stage(descriptor="iterated-16", pairs=3), Stage(descriptor="iterated-16"))
    cascade = train_cascade(replace(TINY, clusters=1, stages=stages), tmp_path)
    first, second = cascade.stages
    assert len(first.scaler.pairs) == 3
    np.testing.assert_array_equal(second.scaler.pairs, all_pairs(DESCRIPTORS["iterated-16"].size))


def test_a_stage_may_have_its_own_number_of_epochs(tmp_path):
    stages = (Stage(descriptor="B"), Stage(descriptor="B", epochs=3))
    passes = []
    train_cascade(replace(TINY, clusters=1, stages=stages, fit=Fit(epochs=2)), tmp_path, record=passes.append)
    assert [done.stage for done in passes] == [1, 1, 2, 2, 2]


def test_a_stage_may_learn_from_a_part_of_the_generated_meshes_and_all_given_ones(tmp_path):
    own = list(pairs(replace(TINY.data, seed=1), [0], workers=1))
    config = replace(TINY, clusters=1, faces_per_mesh=2000, fit=Fit(epochs=1))  # all faces of each mesh
    few = replace(config, data=replace(TINY.data, count=2), stages=(Stage(descriptor="B"),))
    some = replace(config, stages=(Stage(descriptor="B", meshes=2), Stage(descriptor="B", meshes=9)))
    (alone,) = train_cascade(few, tmp_path / "few", own=own).stages
    first, _ = train_cascade(some, tmp_path / "some", own=own).stages
    for name in (field.name for field in fields(FeatureScaler)):
        np.testing.assert_array_equal(getattr(first.scaler, name), getattr(alone.scaler, name))


def test_chord_is_twice_the_sine_of_half_the_angle():
    angle = torch.tensor([0.2, 1.0])
    turned = torch.stack([torch.cos(angle), torch.sin(angle), 0 * angle], dim=1)
    found = chordal_distance(turned, torch.tensor([[1.0, 0, 0]]).expand(2, 3))
    np.testing.assert_allclose(found, [2 * np.sin(0.1), 2 * np.sin(0.5)], rtol=1e-4)
    assert angle_sum(found) == pytest.approx(np.degrees(1.2), rel=1e-4)


def test_early_stopping_returns_the_best_pass():
    faces, scaler = to_learn_from(icosphere(2), 0.3)
    seen: list[float] = []
    rows, fit = np.arange(len(faces.truth)), Fit(epochs=200, batch=16, hidden=(64,), patience=3)
    train_network(faces, rows, scaler, fit, "tanh", seed=0, log=lambda *said: seen.append(said[2]))
    assert len(seen) < 200
    assert np.argmin(seen) == len(seen) - 1 - fit.patience


def test_a_tiny_training_beats_the_noisy_input(trained):
    clean = icosphere(3)
    mesh = noisy(clean, 0.15, seed=5)
    assert mean_angle(mesh.moved(trained.vertices(mesh)), clean) < 0.6 * mean_angle(mesh, clean)


def test_same_seed_same_bytes_and_another_seed_others(trained, tmp_path):
    assert train_cascade(TINY, tmp_path / "again").to_bytes() == trained.to_bytes()
    other = TrainConfig(**{f.name: getattr(TINY, f.name) for f in fields(TINY)} | {"seed": 1})
    assert train_cascade(other, tmp_path / "other").to_bytes() != trained.to_bytes()


def test_stages_follow_a_given_first_stage(trained, tmp_path):
    config = replace(TINY, stages=TINY.stages[1:])
    follow = partial(train_cascade, config, tmp_path, first=trained.stages[0])
    with pytest.raises(Interrupted):
        follow(progress=interrupt_at("stage 2 cluster 1", 2))
    with pytest.raises(ConfigError, match="holds a training with other settings"):
        train_cascade(config, tmp_path, first=trained.stages[1])
    continued = follow()
    assert continued.begins_like(trained) and not replace(continued, stages=continued.stages[1:]).begins_like(trained)
    assert [stage.settings for stage in continued.stages] == list(TINY.stages)
    for stage, other in zip(continued.stages, trained.stages, strict=True):  # same seeds, meshes and first stage
        assert all(np.array_equal(array, other.arrays()[name]) for name, array in stage.arrays().items())
    assert len(continued.card["validation_chord_by_stage_and_cluster"]) == 2


@pytest.mark.parametrize(("task", "done"), [("noisy/clean pairs", 2), ("stage 1 cluster 2", 3), ("apply stage 2", 1)])
def test_an_interrupted_training_goes_on_to_the_same_bytes(trained, tmp_path, task, done):
    with pytest.raises(Interrupted):
        train_cascade(TINY, tmp_path, progress=interrupt_at(task, done))
    assert train_cascade(TINY, tmp_path).to_bytes() == trained.to_bytes()


def test_processes_that_work_side_by_side_change_no_byte(trained, tmp_path):
    with limit_threads(2):
        assert train_cascade(TINY, tmp_path).to_bytes() == trained.to_bytes()


def test_pairs_that_are_made_are_not_made_again(trained, tmp_path, monkeypatch):
    with pytest.raises(Interrupted):
        train_cascade(TINY, tmp_path, progress=interrupt_at("noisy/clean pairs", 2))
    asked = []

    def watched(config, indices, workers):
        asked.extend(indices)
        return pairs(config, indices, workers=workers)

    monkeypatch.setattr(training, "pairs", watched)
    assert train_cascade(TINY, tmp_path).to_bytes() == trained.to_bytes()
    assert asked == [2, 3]


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


def test_the_folder_of_another_training_is_refused(tmp_path):
    with pytest.raises(Interrupted):
        train_cascade(TINY, tmp_path, progress=interrupt_at("noisy/clean pairs", 1))
    with pytest.raises(ValueError, match="holds a training with other settings"):
        train_cascade(TrainConfig(seed=7), tmp_path)


def test_the_folder_of_another_version_is_refused(tmp_path, monkeypatch):
    with pytest.raises(Interrupted):
        train_cascade(TINY, tmp_path, progress=interrupt_at("noisy/clean pairs", 1))
    monkeypatch.setattr(checkpoints, "CASCADE_FORMATS", ("cascadenorm/another",))
    with pytest.raises(ConfigError, match="another version"):
        train_cascade(TINY, tmp_path)


def test_more_directions_than_features_are_all_of_them(tmp_path):
    one = replace(
        TINY,
        stages=(Stage(descriptor="B"),),
        context=60,
        fit=Fit(hidden=(4,), epochs=1),
        data=replace(TINY.data, count=1),
    )
    assert train_cascade(one, tmp_path).stages[0].scaler.projection.shape == (45, 45)


def test_more_clusters_than_faces_are_refused_in_words(tmp_path):
    few = replace(TINY, faces_per_mesh=1, clusters=5)
    with pytest.raises(ConfigError, match="5 clusters are more than the faces to learn from, 4"):
        train_cascade(few, tmp_path)


def test_a_training_that_diverges_is_refused():
    faces, scaler = to_learn_from(cube(4), 0.25)
    with pytest.raises(ConfigError, match="the training diverged"):
        fit = Fit(epochs=2, batch=16, learning_rate=1e30)
        train_network(faces, np.arange(len(faces.truth)), scaler, fit, "tanh", seed=0)


def test_a_process_that_a_scheduler_has_numbered_is_alone_all_the_same(monkeypatch):
    for name in ("RANK", "LOCAL_RANK"):
        monkeypatch.setenv(name, "3")
    assert is_main() and is_local_main()
    monkeypatch.setenv("WORLD_SIZE", "4")
    with pytest.raises(ConfigError, match="LOCAL_WORLD_SIZE is not"):
        is_main()
    monkeypatch.setenv("LOCAL_WORLD_SIZE", "4")
    assert not is_main() and not is_local_main()


@pytest.mark.parametrize(("count", "expected"), [(0, "cpu"), (1, "cpu"), (2, "cuda:1")])
def test_each_process_has_a_gpu_of_its_own_or_none_has_one(monkeypatch, count, expected):
    for name, value in {"WORLD_SIZE": "4", "LOCAL_WORLD_SIZE": "2", "LOCAL_RANK": "1", "RANK": "3"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
    assert distributed.device() == torch.device(expected)
    with ThreadPoolExecutor(1) as pool:  # networks are trained in threads, which do not know of one another's GPU
        assert pool.submit(distributed.device).result() == torch.device(expected)


def test_the_settings_of_cascade_are_those_of_the_paper():
    """B-FND and G-FND, then B-FND twice; clusters with one hidden layer each; context features are our addition."""
    config = read_config(Path(__file__).parents[2] / "configs" / "cascade.toml")
    assert [stage.descriptor for stage in config.stages] == ["B+G", "B", "B"]
    for stage in config.stages:
        assert (stage.weighting, stage.foldovers) == ("uniform", "ignore")
        assert (stage.activation, stage.sweeps) == ("tanh", 20)
    assert (config.clusters, config.context, len(config.fit.hidden)) == (4, 24, 1)


def test_a_training_without_settings_is_that_of_the_vertex_network():
    assert read_config(Path(__file__).parents[2] / "configs" / "vertex.toml") == TrainConfig()


def test_settings_are_read_from_toml(tmp_path):
    path = tmp_path / "some.toml"
    path.write_text(
        'clusters = 3\n[[stages]]\ndescriptor = "B"\nsweeps = 3\n[[stages]]\ndescriptor = "B+G"\n'
        '[fit]\nlearning_rate = 1\n[data]\ncount = 5\nfamilies = ["rock"]\n'
    )
    config = read_config(path)
    assert config.stages == (Stage(descriptor="B", sweeps=3), Stage(descriptor="B+G"))
    assert (config.clusters, config.fit.learning_rate) == (3, 1.0)
    assert (config.data.count, config.data.families, config.seed) == (5, ("rock",), TrainConfig().seed)
    assert config.data.max_level == TrainConfig().data.max_level


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cluster = 3", "there is no setting cluster"),
        (f"seed = {'9' * 5000}", "is not TOML"),
        ("[fit]\nwidth = 3", "there is no setting fit.width; fit settings are hidden"),
        ("seed = -1", "seed is -1; it must be at least 0"),
        ("context = -1", "context is -1; it must be at least 0"),
        ("[fit]\nweight_decay = -1", "weight_decay is -1.0; it must be at least 0"),
        ("[data]\nmin_faces = 1000", "faces are 1000 to 20000; at least 1200"),
        ("fit = 3", "fit is 3; it must be a table"),
        ('clusters = "many"', "clusters is 'many'; it must be of type int"),
        ("clusters = 0", "clusters is 0"),
        ("stages = 3", "stages is 3; it must be a list"),
        ("stages = []", "stages is empty"),
        ("stages = [3]", "stages is 3; it must be a table"),
        ("[[stages]]\nsweeps = 3", "stages has no descriptor"),
        (STAGE + "sweep = 3", "there is no setting stages.sweep; stages settings are descriptor"),
        (STAGE + "sweeps = -1", "sweeps is -1; it must be at least 0"),
        (STAGE + "pairs = -1", "pairs is -1; it must be at least 0"),
        (STAGE + 'sweeps = "many"', "stages.sweeps is 'many'; it must be of type int"),
        ('[[stages]]\ndescriptor = "C"', "descriptor is 'C'; it must be one of B, B"),
        (STAGE + 'weighting = "areas"', "weighting is 'areas'; it must be one of uniform, cotangent"),
        (STAGE + 'foldovers = "mend"', "foldovers is 'mend'; it must be one of avoid, ignore"),
        (STAGE + 'activation = "relu"', "activation is 'relu'; it must be one of silu, tanh"),
        ("[fit]\nepochs = 0", "epochs is 0"),
        ("[fit]\nhidden = []", r"fit\.hidden is \[\]"),
        ('[data]\nfamilies = ["teapot"]', "teapot"),
        ("clusters = = 3", "is not TOML"),
    ],
)
def test_settings_that_cannot_be_are_refused(tmp_path, text, message):
    path = tmp_path / "some.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_config(path)
