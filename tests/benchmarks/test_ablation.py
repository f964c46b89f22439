"""The ablation of benchmarks/, with tiny settings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shapes import icosphere, noisy

from benchmarks.accuracy import ablation
from cascadenorm.data_gen import DatasetConfig
from cascadenorm.learned.config import Fit, TrainConfig, read_config
from cascadenorm.learned.stage import Stage
from cascadenorm.mesh import limit_threads

ROOT = Path(__file__).parents[2]

PAPER, AUTO = (read_config(ROOT / "configs" / f"{name}.toml") for name in ("cascade", "surface"))
TINY = TrainConfig(
    faces_per_mesh=100,
    fit=Fit(hidden=(4,), epochs=1),
    data=DatasetConfig(count=2, families=("smooth",), min_faces=1200, max_faces=1250),
)
OTHER = (Stage(descriptor="n+B"),)
SETS = {"balls": [(noisy(icosphere(2), 0.2), icosphere(2).face_normals)]}


def test_the_ladder_leads_from_the_paper_to_auto_on_the_same_data():
    rungs = list(ablation.ladder(PAPER, AUTO).values())
    assert rungs[0].stages == PAPER.stages and rungs[0].context == 0
    assert replace(rungs[-1], clusters=AUTO.clusters) == AUTO
    assert all(rung.data == AUTO.data and rung.faces_per_mesh == AUTO.faces_per_mesh for rung in rungs)
    assert len(set(map(repr, rungs))) == len(rungs)


def test_a_table_has_the_mean_and_half_the_spread():
    angles = [{"here": 1.0, "there": 5.0}, {"here": 2.0, "there": 5.5}]
    trainings = [{"rung": "a", "clusters": 1, "seed": seed, "degrees": found} for seed, found in enumerate(angles)]
    table = ablation.table({"count": 2, "max_faces": 1250, "trainings": trainings})
    assert "Trained on 2 shapes of at most 1,250 faces." in table
    assert table.endswith("| a | 1 | 2 | 1.50 ± 0.50 | 5.25 ± 0.25 |")


def test_each_kind_of_error_is_measured_by_the_true_normals():
    small = replace(AUTO.data, min_faces=1200, max_faces=1800)
    with limit_threads(1):  # starts no other process
        sets = ablation.measured_on(ROOT / "cascadenorm" / "demo_data", small, unseen=1)
    assert all(len(found) >= 1 for found in sets.values())
    mesh, normals = sets["segmentations"][0]
    assert normals.shape == (len(mesh.faces), 3)
    assert not np.allclose(normals, mesh.face_normals)


class Interrupted(Exception):
    pass


def test_an_interrupted_ablation_goes_on_to_the_same_table_and_shares_its_pairs(tmp_path, monkeypatch):
    few = replace(TINY, stages=(Stage(descriptor="B"),), context=0)
    rungs = {"one": few, "other": replace(few, stages=OTHER)}

    def run(folder: Path) -> str:
        with limit_threads(1):
            return ablation.table(ablation.run(rungs, SETS, folder, seeds=[0], clusters=[1, 2]))

    whole, halfway = tmp_path / "whole", tmp_path / "halfway"
    expected = run(whole)
    assert expected.count(" ± ") == 4
    trainings, train = [], ablation.training.train_cascade

    def interrupted(config, *arguments, **settings):
        if len(trainings) == 2:
            raise Interrupted
        trainings.append(config)
        return train(config, *arguments, **settings)

    monkeypatch.setattr(ablation.training, "train_cascade", interrupted)
    with pytest.raises(Interrupted):
        run(halfway)
    (made,) = halfway.glob("pairs-*")
    written = {path: path.stat().st_mtime_ns for path in [*made.iterdir(), *halfway.glob("rung0*")]}
    assert len(written) == TINY.data.count + 2
    trainings.clear()
    assert run(halfway) == expected
    assert [config.stages for config in trainings] == [OTHER] * 2
    assert all(path.stat().st_mtime_ns == time for path, time in written.items())
    for path in halfway.glob("rung*"):
        path.unlink()
    assert run(halfway) == expected  # from the figures that were kept
    assert len(trainings) == 2
