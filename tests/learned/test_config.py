"""Settings of trainings are read from TOML, and those that cannot be are refused in words."""

from pathlib import Path

import pytest

from cascadenorm.learned.config import ConfigError, TrainConfig, read_config
from cascadenorm.learned.stage import Stage

STAGE = '[[stages]]\ndescriptor = "B"\n'


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
