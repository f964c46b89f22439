"""Training of a cascade: data → descriptors → k-means → one network a cluster → next stage (Wang, Liu, Tong 2016)."""

import json
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.numpy import load_file, save_file
from sklearn.cluster import KMeans
from threadpoolctl import threadpool_limits

from cascadenorm.data_gen import Pair, pairs
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.config import TrainConfig
from cascadenorm.learned.descriptors import DESCRIPTORS, pose_free
from cascadenorm.learned.networks import Array, Faces, train_network
from cascadenorm.learned.regression import Regression
from cascadenorm.mesh import Mesh, thread_count

KMEANS_FACES = 100_000


class Progress(Protocol):
    """What a training tells while it runs."""

    def __call__(self, task: str, done: int, total: int, note: str = "") -> None:
        """Say that `done` of `total` parts of a task are done."""


def silent(task: str, done: int, total: int, note: str = "") -> None:
    """Tell nothing."""


@dataclass
class _Sample:
    """A training mesh as it stands before the coming stage, with the true normals and the faces drawn from it."""

    mesh: Mesh
    truth: Array
    rows: NDArray[np.intp]


def train(config: TrainConfig, checkpoint: Path, *, progress: Progress = silent) -> Cascade:
    """Train a cascade; an interrupted training that is started again goes on, and ends with the same bytes.

    Parameters
    ----------
    config : what to train
    checkpoint : folder for what is finished; it is made, and may hold an interrupted training of the same config
    progress : called as parts finish

    Raises
    ------
    ValueError : the folder holds a training of another config
    """
    _claim(checkpoint, config)
    samples = [_sample(made, i, config) for i, made in enumerate(_generated(config, progress))]
    stages: list[Regression] = []
    with _one_thread_each():
        for number, descriptor in enumerate(config.descriptors):
            stage = _train_stage(samples, config, checkpoint, number, descriptor, progress)
            stages.append(stage)
            if number + 1 < len(config.descriptors):
                for i, sample in enumerate(samples):
                    sample.mesh = next(Cascade((stage,), {}).steps(sample.mesh, sweeps=config.sweeps))
                    progress(f"apply stage {number + 1}", i + 1, len(samples))
    return Cascade(tuple(stages), {"config": asdict(config)})


def _train_stage(
    samples: list[_Sample], config: TrainConfig, checkpoint: Path, number: int, descriptor: str, progress: Progress
) -> Regression:
    """Train a stage on the samples as they stand, or read it if it is finished."""
    finished = checkpoint / f"stage{number}.safetensors"
    if finished.exists():
        return Regression(descriptor=descriptor, **load_file(finished))
    faces = _described(samples, descriptor, f"descriptors {number + 1}", progress)
    mean = faces.descriptors.mean(axis=0, dtype=np.float64).astype(np.float32)
    scale = (1 / faces.descriptors.std(axis=0, dtype=np.float64)).astype(np.float32)
    np.multiply(np.subtract(faces.descriptors, mean, out=faces.descriptors), scale, out=faces.descriptors)
    rng = np.random.default_rng([config.seed, number])
    some = rng.choice(len(faces.truth), min(KMEANS_FACES, len(faces.truth)), replace=False)
    kmeans = KMeans(config.clusters, n_init=4, random_state=int(rng.integers(2**31))).fit(faces.descriptors[some])
    centers = np.ascontiguousarray(kmeans.cluster_centers_, np.float32)
    empty = np.empty(0, np.float32)
    stage = Regression(
        descriptor=descriptor, mean=mean, scale=scale, centers=centers,
        weight1=empty, bias1=empty, weight2=empty, bias2=empty,
    )  # fmt: skip
    cluster = stage.cluster(faces.descriptors)

    def one(c: int) -> Mapping[str, Array]:
        part = checkpoint / f"stage{number}-cluster{c}.safetensors"
        if not part.exists():

            def log(epoch: int, loss: float, validation: float) -> None:
                note = f"{(cluster == c).sum()} faces, loss {loss:.4f}, validation {validation:.4f}"
                progress(f"stage {number + 1} cluster {c + 1}", epoch, config.fit.epochs, note)

            mine = faces.take(np.flatnonzero(cluster == c))
            seed = np.random.SeedSequence([config.seed, number, c]).generate_state(1)[0]
            _save(part, train_network(mine, config.fit, seed=int(seed), log=log))
        return load_file(part)

    with ThreadPoolExecutor(thread_count()) as pool:
        networks = list(pool.map(one, range(config.clusters)))
    stage = replace(stage, **{name: np.stack([network[name] for network in networks]) for name in networks[0]})
    _save(finished, stage.arrays())
    return stage


def _described(samples: list[_Sample], descriptor: str, task: str, progress: Progress) -> Faces:
    """Collect what the drawn faces of all samples show and what they should be."""
    stacks = []
    for i, sample in enumerate(samples):
        stacks.append(DESCRIPTORS[descriptor](sample.mesh)[sample.rows])
        progress(task, i + 1, len(samples))
    stack = np.concatenate(stacks)
    return Faces(pose_free(stack), stack, np.concatenate([s.truth for s in samples]))


def _generated(config: TrainConfig, progress: Progress) -> Iterator[Pair]:
    for done, made in enumerate(pairs(config.data, workers=thread_count())):
        progress("noisy/clean pairs", done + 1, config.data.count)
        yield made


def _sample(made: Pair, index: int, config: TrainConfig) -> _Sample:
    """Draw the faces of a pair."""
    rng = np.random.default_rng([config.seed, index])
    whole = np.flatnonzero(made.clean.areas > 0)
    rows = np.sort(rng.choice(whole, min(config.faces_per_mesh, len(whole)), replace=False))
    return _Sample(made.noisy, made.clean.normals[rows].astype(np.float32), rows)


def _claim(checkpoint: Path, config: TrainConfig) -> None:
    """Make the folder for this config, or see that it is this config's."""
    checkpoint.mkdir(parents=True, exist_ok=True)
    note, text = checkpoint / "config.json", json.dumps(asdict(config), indent=1, sort_keys=True)
    if note.exists() and note.read_text() != text:
        raise ValueError(f"{checkpoint} holds a training with other settings: remove it, or name another folder")
    note.write_text(text)


def _save(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write at once or not at all, so that a file that exists is finished."""
    partial = path.with_suffix(".partial")
    save_file(dict(arrays), partial)
    os.replace(partial, path)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Keep torch and BLAS to one thread a call, so that sums do not depend on the machine's cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(before)
