"""Train a cascade of stages (Wang, Liu, Tong 2016).

For each stage, the meshes are filtered, the features of the faces are clustered by k-means, and one network is trained
per cluster.
"""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from sklearn.cluster import KMeans
from threadpoolctl import threadpool_limits

from cascadenorm.data_gen import Pair, pairs
from cascadenorm.execution.process_map import Map, parallel_map
from cascadenorm.execution.progress import Progress, no_progress
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.config import ConfigError, TrainConfig
from cascadenorm.learned.descriptors import Stack
from cascadenorm.learned.features import Array, FeatureScaler, all_pairs, pairwise_features
from cascadenorm.learned.regression import Regression, nearest
from cascadenorm.learned.stage import Stage
from cascadenorm.learned.training import checkpoints, distributed
from cascadenorm.learned.training.launch import is_local_main, is_main
from cascadenorm.learned.training.network_training import TrainingFaces, train_network
from cascadenorm.learned.training.samples import Sample
from cascadenorm.learned.training.training_log import Pass, Recorder, unrecorded
from cascadenorm.mesh import Ints32, Vectors, in_blocks, thread_count

KMEANS_FACES = 50_000
SCALER_MESHES = 500  # number of meshes whose faces determine mean, deviation and principal directions
LEAST_DEVIATION = 0.1  # smallest deviation of a feature; that of logarithms is 2 or more, that of openness a third
LEAST_VARIANCE = 0.01  # smallest share of the variance of a pair that the pairs chosen before it leave
FEATURES_AT_A_TIME = 32  # number of features whose deviations are computed together, in double precision


def train_cascade(
    config: TrainConfig,
    checkpoint: Path,
    *,
    own: Sequence[Pair] = (),
    first: Regression | None = None,
    generated: Path | None = None,
    progress: Progress = no_progress,
    record: Recorder = unrecorded,
) -> Cascade:
    """Train a cascade. An interrupted training resumes and gives byte-identical results.

    Several processes started by torchrun share the meshes and return the same cascade. Rank 0 writes. The folder
    `checkpoint` holds finished parts; it is created if needed. `own` are training pairs beside the generated ones.
    `first` is a trained first stage, which the stages of the config follow. The generated pairs are kept in the folder
    `generated`, which trainings with the same `config.data` can share; by default, it lies in `checkpoint`. `progress`
    is called when parts finish, and `record` after each epoch of a network, with several clusters from several threads.
    Raises ConfigError if the folder holds a training with another config, other pairs or another first stage, or there
    are fewer meshes than processes.
    """
    with distributed.process_group(), _one_thread_each():
        progress, record = (progress, record) if is_main() else (no_progress, unrecorded)
        return _trained(config, checkpoint, own, first, generated or checkpoint / "pairs", progress, record)


def _trained(
    config: TrainConfig,
    checkpoint: Path,
    own: Sequence[Pair],
    first: Regression | None,
    generated: Path,
    progress: Progress,
    record: Recorder,
) -> Cascade:
    fewest = min([config.data.count, *(stage.meshes for stage in config.stages if stage.meshes)]) + len(own)
    if fewest < distributed.world_size():
        raise ConfigError(f"{distributed.world_size()} processes are more than the meshes, {fewest}: take fewer")
    if is_local_main():
        checkpoints.claim(checkpoint, config, own, first)
    distributed.barrier()  # the folder exists on each machine from here on
    samples = _samples(config, own, generated, progress)
    stages = [] if first is None else [first]
    losses: list[list[float]] = []
    with parallel_map(distributed.cores()) as each:
        for settings in config.stages:
            if stages:
                moved = each(partial(Sample.apply_stage, stage=stages[-1]), samples)
                for done, vertices in enumerate(moved):
                    samples[done].vertices = vertices
                    progress(f"apply stage {len(stages)}", done + 1, len(samples))
            arrays = _train_stage(samples, each, config, checkpoint, len(stages), settings, progress, record)
            stages.append(Regression.from_arrays(settings, arrays))
            losses.append([round(float(loss), 5) for loss in arrays["validation"]])
    faces = int(distributed.all_reduce(np.array(sum(len(sample.rows) for sample in samples), np.float64)))
    card = _card(config, own, faces, losses)
    return Cascade(tuple(stages), card if first is None else {**card, "first_stage": "that of another cascade"})


def _train_stage(
    samples: list[Sample],
    each: Map,
    config: TrainConfig,
    checkpoint: Path,
    number: int,
    settings: Stage,
    progress: Progress,
    record: Recorder,
) -> dict[str, Array]:
    """Train a stage on the samples, or read it if it is finished. Returns its arrays, including the losses."""
    finished = checkpoint / f"stage{number}.safetensors"
    if done := distributed.broadcast(partial(checkpoints.read_arrays, finished)):
        return done
    generated = config.data.count
    samples = [one for one in samples if one.index < (settings.meshes or generated) or one.index >= generated]
    rng = np.random.default_rng([config.seed, number])
    fit = replace(config.fit, epochs=settings.epochs or config.fit.epochs)
    scaler, faces = _described(samples, each, config, settings, f"stage {number + 1} descriptors", progress)
    stack, context = faces.stack.numpy(), faces.context.numpy()

    def features(rows: NDArray[np.intp] | slice) -> Array:
        return scaler.features(stack[rows], context[rows])

    some = rng.choice(len(stack), min(KMEANS_FACES // distributed.world_size(), len(stack)), replace=False)
    drawn = distributed.all_gather(features(some))
    if len(drawn) < config.clusters:
        raise ConfigError(f"{config.clusters} clusters are more than the faces to learn from, {len(drawn)}: take fewer")
    kmeans = KMeans(config.clusters, n_init=2, random_state=int(rng.integers(2**31)))
    centers = distributed.broadcast(lambda: np.ascontiguousarray(kmeans.fit(drawn).cluster_centers_, np.float32))
    cluster = in_blocks(len(stack), lambda start, stop: nearest(features(slice(start, stop)), centers))
    faces = faces.placed()

    def one(c: int) -> Mapping[str, Array]:
        part = checkpoint / f"stage{number}-cluster{c}.safetensors"
        if done := distributed.broadcast(partial(checkpoints.read_arrays, part)):
            return done
        mine = np.flatnonzero(cluster == c)
        count = int(distributed.all_reduce(np.array(float(len(mine)))))
        if not count:
            raise ConfigError(f"cluster {c + 1} has no face to learn from: take fewer clusters, or more meshes")

        task, notes = f"stage {number + 1} cluster {c + 1}", list[str]()

        def log(epoch: int, loss: float, validation: float, angle: float) -> None:
            notes.append(f"{count} faces, loss {loss:.4f}, validation {validation:.4f} ({angle:.2f}°)")
            progress(task, epoch, fit.epochs, notes[-1])
            record(Pass(number + 1, c + 1, epoch, loss, validation, angle))

        seed = np.random.SeedSequence([config.seed, number, c]).generate_state(1)[0]
        network = train_network(faces, mine, scaler, fit, settings.activation, seed=int(seed), log=log)
        checkpoints.write_shared_arrays(part, network)
        if len(notes) < fit.epochs:  # stopped early
            progress(task, fit.epochs, fit.epochs, notes[-1])
        return network

    with ThreadPoolExecutor(thread_count() if distributed.world_size() == 1 else 1) as pool:
        networks = list(pool.map(one, range(config.clusters)))
    weights = {name: np.stack([network[name] for network in networks]) for name in networks[0]}
    arrays = {**asdict(scaler), "centers": centers, **weights}
    checkpoints.write_shared_arrays(finished, arrays)
    return arrays


def _card(config: TrainConfig, own: Sequence[Pair], faces: int, losses: list[list[float]]) -> dict[str, Any]:
    """Return the model card: origin, training data and losses. It depends only on the config and the pairs."""
    others = f"and {len(own)} given pairs" if own else "no third-party meshes"
    return {
        "model": "cascaded normal regression (Wang, Liu, Tong 2016)",
        "made_with": checkpoints.versions(),
        "data": f"procedural shapes with simulated noise from cascadenorm.data_gen; {others}",
        "faces_trained_on": faces,
        "validation_chord_by_stage_and_cluster": losses,
        "limits": "errors like those of the meshes it was trained on; detail as fine as the error may be lost with it",
        "licence": "MIT",
        "config": asdict(config),
    }


def _described(
    samples: list[Sample], each: Map, config: TrainConfig, settings: Stage, task: str, progress: Progress
) -> tuple[FeatureScaler, TrainingFaces]:
    """Fit the feature scaler, and collect the filtered normals, context and targets of the drawn faces.

    The context features depend on the principal directions, which are computed from a part of the samples first.
    """
    few = samples[:: -(-len(samples) * distributed.world_size() // SCALER_MESHES)]
    steps = len(few) + len(samples)
    stacks = []
    for done, stack in enumerate(each(partial(Sample.stack, settings=settings), few), 1):
        stacks.append(stack)
        progress(task, done, steps)
    stack = np.concatenate(stacks)
    pairs = all_pairs(stack.shape[1])
    if 0 < settings.pairs < len(pairs):
        pairs = informative_pairs(stack, np.concatenate([sample.truth for sample in few]), settings.pairs)
    own = pairwise_features(stack, pairs)
    mean, scale = _mean_and_scale(own)
    own -= mean
    own *= scale
    covariance = distributed.all_reduce(np.asarray(own.T.astype(np.float64) @ own))
    del own
    directions = np.linalg.eigh(covariance)[1][:, : -1 - config.context : -1]
    directions *= np.sign(np.take_along_axis(directions, np.abs(directions).argmax(axis=0)[None], axis=0))
    none = np.zeros(1, np.float32)
    scaler = FeatureScaler(
        pairs=pairs, mean=mean, scale=scale, projection=np.ascontiguousarray(directions, np.float32),
        context_mean=none, context_scale=none + 1,
    )  # fmt: skip
    truth = np.concatenate([sample.truth for sample in samples])
    stop = 0
    work = partial(Sample.described, settings=settings, scaler=scaler)
    for done, parts in enumerate(each(work, samples), 1):
        if done == 1:
            collected = tuple(np.empty((len(truth), *part.shape[1:]), np.float32) for part in parts)
        start, stop = stop, stop + len(parts[0])
        for whole, part in zip(collected, parts, strict=True):
            whole[start:stop] = part
        progress(task, len(few) + done, steps)
    context_mean, context_scale = _mean_and_scale(collected[1])
    scaler = replace(scaler, context_mean=context_mean, context_scale=context_scale)
    return scaler, TrainingFaces(*map(torch.from_numpy, (*collected, truth)))


def informative_pairs(stack: Stack, truth: Array, count: int) -> Ints32:
    """Return the pairs of filtered normals, (count, 2) in row order, that best show the error of each filtered normal.

    The stack, (m, k, 3), has the filtered normals, and `truth`, (m, 3), the true ones. The pairs are chosen one after
    the other (orthogonal least squares, Chen, Billings, Luo 1989). Each is the one that explains most of the variance
    of the features of filtered and true normals that the pairs before it leave.
    """
    pairs, last = all_pairs(stack.shape[1] + 1), stack.shape[1]
    features = pairwise_features(np.concatenate([stack, truth[:, None]], axis=1), pairs)
    mean, scale = _mean_and_scale(features)
    features = (features - mean) * scale
    left = distributed.all_reduce(np.asarray(features.T.astype(np.float64) @ features))
    left /= left.diagonal().max()
    candidates, targets = np.flatnonzero(pairs[:, 1] < last), np.flatnonzero(pairs[:, 1] == last)
    chosen = list[np.intp]()
    for _ in range(count):
        variances = np.maximum(left[candidates, candidates], LEAST_VARIANCE)
        gains = np.square(left[np.ix_(candidates, targets)]).sum(axis=1) / variances
        gains[np.isin(candidates, chosen)] = -1
        chosen.append(best := candidates[gains.argmax()])
        left -= np.outer(left[best], left[best] / max(left[best, best], np.finfo(float).tiny))
    return pairs[np.sort(chosen)]


def _mean_and_scale(x: Array) -> tuple[Array, Array]:
    """Return mean and reciprocal deviation of each column. The deviation has a lower bound.

    The bound keeps features that hardly vary in the training data from dominating on other meshes.
    """
    count = distributed.all_reduce(np.array(float(len(x))))
    mean = distributed.all_reduce(x.sum(axis=0, dtype=np.float64)) / count
    squares = np.zeros(len(mean))
    for start in range(0, len(mean), FEATURES_AT_A_TIME):
        columns = slice(start, start + FEATURES_AT_A_TIME)
        squares[columns] = np.square(x[:, columns] - mean[columns]).sum(axis=0)
    deviation = np.sqrt(distributed.all_reduce(squares) / count)
    return mean.astype(np.float32), (1 / np.maximum(deviation, LEAST_DEVIATION)).astype(np.float32)


def _samples(config: TrainConfig, own: Sequence[Pair], folder: Path, progress: Progress) -> list[Sample]:
    """Return this process's shard of the generated and the given pairs. Missing generated pairs are made and stored."""
    folder.mkdir(parents=True, exist_ok=True)
    count = config.data.count
    mine = range(count + len(own))[distributed.rank() :: distributed.world_size()]
    generated, others = [i for i in mine if i < count], [i for i in mine if i >= count]
    files = {i: folder / f"{i:05d}.safetensors" for i in generated}
    missing = [i for i in generated if not files[i].exists()]
    made = zip(missing, pairs(config.data, missing, workers=distributed.cores()), strict=True)
    for done, (i, new) in enumerate(made, len(generated) - len(missing) + 1):
        checkpoints.write_arrays(
            files[i], {"noisy": new.noisy.vertices, "normals": new.normals, "faces": new.clean.faces}
        )
        progress("noisy/clean pairs", done, len(generated))

    def drawn(noisy: Vectors, faces: Ints32, normals: Vectors, index: int) -> Sample:
        return Sample.drawn(index, noisy, faces, normals, count=config.faces_per_mesh, seed=config.seed)

    samples = []
    for i, file in files.items():
        kept = checkpoints.read_arrays(file)
        samples.append(drawn(kept["noisy"], kept["faces"], kept["normals"], i))
    own_pairs = [own[i - count] for i in others]
    return samples + [
        drawn(pair.noisy.vertices, pair.clean.faces, pair.normals, i) for pair, i in zip(own_pairs, others, strict=True)
    ]


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Limit torch and BLAS to one thread per call, so that sums do not depend on the number of cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(before)
