"""A training gives the same bytes for the same seed, interrupted or not, and a cascade that denoises."""

from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest
from shapes import icosphere, mean_angle, noisy
from trainings import TINY, Interrupted, interrupt_at

from cascadenorm.data_gen import pairs
from cascadenorm.learned.config import ConfigError, Fit
from cascadenorm.learned.descriptors import DESCRIPTORS
from cascadenorm.learned.features import FeatureScaler, all_pairs
from cascadenorm.learned.stage import Stage
from cascadenorm.learned.training import training
from cascadenorm.learned.training.training import informative_pairs, train_cascade
from cascadenorm.mesh import limit_threads, unit


def test_pairs_that_show_how_far_normals_are_from_the_true_one_are_chosen():
    stack = unit(np.random.default_rng(0).normal(size=(500, 6, 3))).astype(np.float32)
    found = informative_pairs(stack, stack[:, 2], 5)
    np.testing.assert_array_equal(found, [[0, 2], [1, 2], [2, 3], [2, 4], [2, 5]])


def test_a_stage_reads_only_as_many_pairs_as_it_declares(tmp_path):
    stages = (Stage(descriptor="iterated-16", pairs=3), Stage(descriptor="iterated-16"))
    cascade = train_cascade(replace(TINY, clusters=1, stages=stages, fit=Fit(hidden=(4,), epochs=1)), tmp_path)
    first, second = cascade.stages
    assert len(first.scaler.pairs) == 3
    np.testing.assert_array_equal(second.scaler.pairs, all_pairs(DESCRIPTORS["iterated-16"].size))


def test_a_stage_may_have_its_own_number_of_epochs(tmp_path):
    stages = (Stage(descriptor="B"), Stage(descriptor="B", epochs=3))
    passes = []
    train_cascade(
        replace(TINY, clusters=1, stages=stages, fit=Fit(hidden=(4,), epochs=2)), tmp_path, record=passes.append
    )
    assert [done.stage for done in passes] == [1, 1, 2, 2, 2]


def test_a_stage_may_learn_from_a_part_of_the_generated_meshes_and_all_given_ones(tmp_path):
    own = list(pairs(replace(TINY.data, seed=1), [0], workers=1))
    config = replace(TINY, clusters=1, faces_per_mesh=2000, fit=Fit(hidden=(4,), epochs=1))  # all faces of each mesh
    few = replace(config, data=replace(TINY.data, count=2), stages=(Stage(descriptor="B"),))
    some = replace(config, stages=(Stage(descriptor="B", meshes=2), Stage(descriptor="B", meshes=9)))
    (alone,) = train_cascade(few, tmp_path / "few", own=own).stages
    first, _ = train_cascade(some, tmp_path / "some", own=own).stages
    for name in (field.name for field in fields(FeatureScaler)):
        np.testing.assert_array_equal(getattr(first.scaler, name), getattr(alone.scaler, name))


def test_a_tiny_training_beats_the_noisy_input(trained):
    clean = icosphere(3)
    mesh = noisy(clean, 0.15, seed=5)
    assert mean_angle(mesh.moved(trained.vertices(mesh)), clean) < 0.6 * mean_angle(mesh, clean)


def test_same_seed_same_bytes_and_another_seed_others(tmp_path):
    config = replace(TINY, stages=TINY.stages[:1], fit=Fit(hidden=(4,), epochs=2))
    one, again, other = (
        train_cascade(replace(config, seed=seed), tmp_path / str(number)) for number, seed in enumerate((0, 0, 1))
    )
    assert again.to_bytes() == one.to_bytes()
    for name in ("weight1", "centers"):
        assert not np.array_equal(one.stages[0].arrays()[name], other.stages[0].arrays()[name])


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


def test_an_interrupted_training_goes_on_to_the_same_bytes(trained, tmp_path):
    for task, done in (("noisy/clean pairs", 2), ("stage 1 cluster 2", 3), ("apply stage 2", 1)):
        with pytest.raises(Interrupted):
            train_cascade(TINY, tmp_path, progress=interrupt_at(task, done))
    assert train_cascade(TINY, tmp_path).to_bytes() == trained.to_bytes()


@pytest.mark.slow  # two processes load torch; test_distributed.py has two that share the meshes
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
