"""A folder of checkpoints belongs to one training by one version."""

import pytest
from trainings import TINY, Interrupted, interrupt_at

from cascadenorm.learned.config import ConfigError, TrainConfig
from cascadenorm.learned.training import checkpoints
from cascadenorm.learned.training.training import train_cascade


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
