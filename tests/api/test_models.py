"""Models that ship are those of their configurations, and a training makes models that denoise."""

import io
import json
import shlex
import shutil
import subprocess
import sys
from contextlib import redirect_stdout
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from shapes import cube, icosphere, noisy

import cascadenorm as cn
from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.cli import run
from cascadenorm.data_gen import DatasetConfig, pair
from cascadenorm.geometry.metrics import measure
from cascadenorm.learned.cascade import apply_stage
from cascadenorm.learned.config import read_config
from cascadenorm.learned.features import CONTEXT_STEPS
from cascadenorm.learned.methods import shipped
from cascadenorm.learned.regression import stage_stack
from cascadenorm.learned.training.gate_training import GateConfig
from cascadenorm.learned.training.training_log import read_passes
from cascadenorm.mesh import Mesh

ROOT = Path(__file__).parents[2]
HELD_OUT = DatasetConfig(
    seed=1_000_003,
    families=("assembly", "bust", "creature", "turned", "wheel"),
    min_faces=3000,
    max_faces=5000,
    noise_kinds=("normal",),
    min_level=0.2,
)
TINY = """
faces_per_mesh = 300
clusters = 2
[fit]
hidden = [8]
epochs = 15
[data]
count = 2
families = ["smooth"]
min_faces = 1200
max_faces = 1250
"""
NETWORKS = {**shipped("auto").networks, "cascade": shipped("cascade")}


@pytest.mark.parametrize("name", NETWORKS)
def test_the_shipped_weights_have_the_settings_of_their_configuration(name):
    config = read_config(ROOT / "configs" / f"{name}.toml")
    made, expected = NETWORKS[name].card["config"], json.loads(json.dumps(asdict(config)))
    assert made["data"] == expected["data"]
    assert {key: made["fit"][key] for key in expected["fit"]} == expected["fit"]
    assert all(made[key] == expected[key] for key in ("seed", "clusters", "context", "faces_per_mesh"))
    stages = tuple(stage.settings for stage in NETWORKS[name].stages)
    assert stages[len(stages) - len(config.stages) :] == config.stages
    assert len(stages) == len(config.stages) or NETWORKS[name].begins_like(NETWORKS["vertex"])


def test_the_shipped_gate_has_the_settings_of_its_training():
    card = shipped("auto").card["gate"]
    assert card["config"] == json.loads(json.dumps(asdict(GateConfig())))
    angles = card["mean_angles_deg"]["all"]
    assert angles["better"] < angles["chosen"] < min(angles["vertex"], angles["surface"])


def test_the_shipped_cascade_is_the_published_method():
    """B-FND and G-FND, then B-FND twice; clusters with one hidden layer each; context features are our addition."""
    context = 24 * (len(CONTEXT_STEPS) + 1) + 1
    filtered = {"B+G": 2 * 5 + 2 * 4, "B": 2 * 5}
    stages = shipped("cascade").stages
    assert [stage.settings.descriptor for stage in stages] == ["B+G", "B", "B"]
    for stage in stages:
        settings, count = stage.settings, filtered[stage.settings.descriptor]
        assert (settings.weighting, settings.foldovers) == ("uniform", "ignore")
        assert settings.activation == "tanh"
        assert len(stage.centers) == 4 and len(stage.layers) == 2
        assert stage.layers[0][0].shape[1] == stage.centers.shape[1] == count * (count - 1) // 2 + context
        assert stage.layers[-1][1].shape[1] == count


@pytest.fixture(scope="module")
def unseen():
    """Pairs of shapes that no training saw, and the mean error that the bilateral filter leaves there."""
    made = [pair(HELD_OUT, index) for index in (0, 1, 2, 3)]
    bilateral = [measure(cn.denoise(p.noisy, method="bilateral-normal"), p.clean).normal_error_deg for p in made]
    return made, np.mean(bilateral)


@pytest.mark.parametrize("name", NETWORKS)
def test_each_stage_comes_closer_to_shapes_that_no_training_saw(name, unseen):
    made, bilateral = unseen
    errors = np.array(
        [[measure(m, p.clean).normal_error_deg for m in (p.noisy, *NETWORKS[name].steps(p.noisy))] for p in made]
    ).mean(axis=0)
    assert (np.diff(errors) < 0).all(), errors
    assert errors[-1] < bilateral


@pytest.mark.parametrize("name, others", [("vertex", "cotangent"), ("surface", "uniform")])
def test_the_stages_of_auto_fit_vertices_with_the_weights_they_were_trained_for(name, others):
    assert [stage.settings.weighting for stage in NETWORKS[name].stages] == [others, others, "cotangent"]


@pytest.mark.parametrize(
    "update",
    [
        {"weighting": weighting, "foldovers": foldovers, "sweeps": sweeps}
        for weighting in ("uniform", "cotangent")
        for foldovers in ("avoid", "ignore")
        for sweeps in (3, 20)
    ],
)
def test_a_stage_moves_vertices_to_its_normals_as_its_settings_say(update):
    rough, stage = noisy(icosphere(3), 0.4), NETWORKS["vertex"].stages[0]
    stage = replace(stage, settings=replace(stage.settings, **update))
    normals = stage.normals(rough, stage_stack(stage.settings, rough, rough))
    expected = recover_vertices(rough, normals, **update)
    np.testing.assert_array_equal(apply_stage(stage, rough, rough).vertices, expected)


@pytest.mark.parametrize("settings", [{}, {"strength": 1.5}])
@pytest.mark.parametrize("name", ["auto", "cascade"])
def test_a_denoiser_is_the_method_with_its_weights(name, settings):
    mesh = noisy(icosphere(3), 0.2)
    mesh = Mesh(
        np.concatenate([mesh.vertices, 5 + cube(4).vertices]), np.concatenate([mesh.faces, 642 + cube(4).faces])
    )
    expected = cn.denoise(mesh, method=name, **settings).vertices
    np.testing.assert_array_equal(cn.Denoiser.shipped(name).denoise(mesh, **settings).vertices, expected)


def test_a_model_in_a_file_denoises_as_the_default_method_does(tmp_path):
    path, mesh = tmp_path / "mine.safetensors", noisy(icosphere(2), 0.2)
    path.write_bytes(shipped("cascade").to_bytes())
    expected = cn.denoise(mesh, model=path).vertices
    np.testing.assert_array_equal(cn.Denoiser.load(path).denoise(mesh).vertices, expected)


def test_a_denoiser_takes_no_other_method_or_model():
    mesh = noisy(icosphere(2), 0.2)
    with pytest.raises(cn.ParameterError, match="method is set by the Denoiser"):
        cn.Denoiser.shipped("cascade").denoise(mesh, method="auto")
    with pytest.raises(cn.ParameterError, match="model is of type Denoiser; it must be the path"):
        cn.denoise(mesh, model=cn.Denoiser.shipped("cascade"))


def test_a_model_that_does_not_ship_is_refused_with_the_names_of_those_that_do():
    with pytest.raises(cn.ParameterError, match="there is no shipped model 'vertex'; there are: auto, cascade"):
        cn.Denoiser.shipped("vertex")


def test_nobody_changes_the_model_of_all():
    denoiser = cn.Denoiser.shipped()
    denoiser.card["gate"]["threshold"] = 99
    assert denoiser.card["gate"]["threshold"] != 99
    for array in denoiser.model.vertex.stages[0].arrays().values():
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_train_records_each_pass_and_its_curves_are_shown(tmp_path, capsys):
    settings, weights, log = tmp_path / "tiny.toml", tmp_path / "tiny.safetensors", tmp_path / "log.jsonl"
    settings.write_text(TINY)
    words = ["train", "--config", str(settings), "-o", str(weights), "--threads", "1", "--log", str(log)]
    assert run([*words, "--tensorboard", str(tmp_path / "events")]) == 0
    passes = read_passes(log)
    stages = {done.stage for done in passes}
    assert stages == set(range(1, len(read_config(settings).stages) + 1)) and {1, 2} == {p.cluster for p in passes}
    recorded = [
        [min(p.validation for p in passes if (p.stage, p.cluster) == (stage, cluster)) for cluster in (1, 2)]
        for stage in sorted(stages)
    ]
    losses = cn.Denoiser.load(weights).card["validation_chord_by_stage_and_cluster"]
    np.testing.assert_allclose(losses, recorded, atol=1e-5)
    for done in passes:  # the angle is a convex function of the chord, below its secant
        assert np.degrees(2 * np.arcsin(done.validation / 2)) <= done.validation_deg <= 90 * done.validation

    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(tmp_path / "events"))
    events.Reload()
    scalars = [event.value for event in events.Scalars("stage1/cluster2/validation_deg")]
    expected = [done.validation_deg for done in passes if (done.stage, done.cluster) == (1, 2)]
    np.testing.assert_allclose(scalars, expected, rtol=1e-6)

    capsys.readouterr()
    assert run(["models", "--curves", str(log)]) == 0
    best = min((p for p in passes if (p.stage, p.cluster) == (1, 1)), key=lambda p: p.validation)
    assert f"{best.validation_deg:.2f}°" in capsys.readouterr().out
    assert run(words) == 5  # the model is there already
    weights.unlink()
    assert run(words) == 5 and "log" in capsys.readouterr().err  # and so is the log


def test_the_name_of_a_file_is_no_configuration(tmp_path):
    with pytest.raises(
        cn.ParameterError, match="config is of type str; it must be a TrainConfig, which read_config reads"
    ):
        cn.train("configs/cascade.toml", tmp_path / "w.safetensors")


def test_a_training_that_cannot_start_leaves_no_log(tmp_path, monkeypatch, capsys):
    (tmp_path / "tiny.toml").write_text(TINY)
    words = ["train", "--config", str(tmp_path / "tiny.toml"), "-o", str(tmp_path / "w.safetensors")]
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    assert run([*words, "--log", str(tmp_path / "log.csv"), "--tensorboard", str(tmp_path / "runs")]) == 1
    assert "pip install tensorboard" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]
    monkeypatch.undo()
    assert run([*words, "--tensorboard", str(tmp_path / ("long" * 100))]) == 5
    assert "cannot be written: File name too long\n" in capsys.readouterr().err
    (tmp_path / "w.safetensors.training").mkdir()  # as if it had been interrupted
    (tmp_path / "folder.csv").mkdir()
    for log, message in (("folder.csv", "is a folder"), ("absent/log.csv", "does not exist: create it first")):
        assert run([*words, "--log", str(tmp_path / log)]) == 5
        assert message in capsys.readouterr().err


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A folder with the settings of a small training and the model that it made, and what was printed."""
    folder = tmp_path_factory.mktemp("my models")
    (folder / "tiny.toml").write_text(TINY)
    words = ["--config", str(folder / "tiny.toml"), "-o", str(folder / "tiny.safetensors"), "--threads", "1"]
    with redirect_stdout(io.StringIO()) as printed:
        assert run(["train", *words]) == 0
    return folder, printed.getvalue()


def test_train_writes_a_model_that_denoises(trained, tmp_path, capsys):
    folder, printed = trained
    command = shlex.split(printed.rpartition("use it with: ")[2])
    assert command == ["cascadenorm", "denoise", "scan.ply", "--model", str(folder / "tiny.safetensors")]
    assert sorted(path.name for path in folder.iterdir()) == ["tiny.safetensors", "tiny.toml"]
    settings, weights = folder / "tiny.toml", tmp_path / "tiny.safetensors"
    shutil.copy(folder / "tiny.safetensors", weights)
    arguments = ["train", "--config", str(settings), "-o", str(weights), "--threads", "1"]
    mesh = noisy(icosphere(3), 0.2)
    out = cn.Denoiser.load(weights).denoise(mesh.vertices, mesh.faces)
    given, denoised = (measure(m, icosphere(3)).normal_error_deg for m in (mesh, mesh.moved(out)))
    assert denoised < 0.6 * given
    before = weights.read_bytes()
    assert run(arguments) == 5
    assert weights.read_bytes() == before
    assert run(["models", str(weights)]) == 0
    assert json.loads(capsys.readouterr().out)["card"]["config"]["clusters"] == 2
    assert run([*arguments, "--force", "--seed", "1"]) == 0
    assert weights.read_bytes() != before


def test_without_what_makes_shapes_neither_training_nor_generating_begins(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "skimage", None)
    assert run(["train", "-o", str(tmp_path / "new.safetensors")]) == 1
    assert 'training needs skimage, which is not installed: pip install "cascadenorm[train]"' in capsys.readouterr().err
    assert run(["generate", str(tmp_path / "data")]) == 1
    needed = 'generating data needs skimage, which is not installed: pip install "cascadenorm[train]"'
    assert needed in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def save(mesh: cn.Mesh, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cn.write(cn.from_arrays(mesh.vertices, mesh.faces), path)


def test_own_meshes_change_the_model_and_stand_in_its_card(trained, tmp_path):
    settings, plain, other = trained[0] / "tiny.toml", trained[0] / "tiny.safetensors", tmp_path / "other.safetensors"
    save(icosphere(3), tmp_path / "ball.ply")
    arguments = ["train", "--config", str(settings), "--threads", "1"]
    assert run([*arguments, "-o", str(other), "--shapes", str(tmp_path / "ball.ply")]) == 0
    assert "and 2 given pairs" in cn.Denoiser.load(other).card["data"]
    assert cn.Denoiser.load(other).model.to_bytes() != cn.Denoiser.load(plain).model.to_bytes()
    assert run([*arguments, "-o", str(tmp_path / "no.safetensors"), "--shapes", str(tmp_path / "no.ply")]) == 3


def test_wrong_settings_are_a_usage_error(tmp_path, capsys):
    settings = tmp_path / "wrong.toml"
    settings.write_text("cluster = 3")
    assert run(["train", "--config", str(settings), "-o", str(tmp_path / "w.safetensors")]) == 2
    assert "there is no setting cluster" in capsys.readouterr().err
    assert run(["train", "--config", str(settings), "--quick"]) == 2


def test_train_py_is_the_same_command():
    done = subprocess.run([sys.executable, ROOT / "train.py", "--help"], capture_output=True, text=True, check=True)
    assert "--quick" in done.stdout and "cascadenorm train" in done.stdout


@pytest.mark.slow
def test_quick_training_beats_the_noisy_input(tmp_path):
    weights = tmp_path / "quick.safetensors"
    assert run(["train", "--quick", "-o", str(weights)]) == 0
    made = pair(HELD_OUT, 0)
    out = cn.Denoiser.load(weights).denoise(made.noisy)
    assert measure(out, made.clean).normal_error_deg < 0.5 * measure(made.noisy, made.clean).normal_error_deg
