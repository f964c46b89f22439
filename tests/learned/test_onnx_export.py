"""What onnxruntime computes from the exported networks is what the cascade computes."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from shapes import cube, noisy

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.learned.cascade import apply_stage
from cascadenorm.learned.methods import shipped
from cascadenorm.learned.packed_normals import unpacked
from cascadenorm.learned.regression import stage_stack

pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

ROUGH = noisy(cube(4), 0.2)


def inputs(session, stage, mesh, stack):
    """What the networks of a stage read; without context features they have one input."""
    feed = {"stack": unpacked(stack)}
    if stage.scaler.context_mean.size:
        feed["context"] = stage.scaler.context(stack, mesh).of()
    assert {given.name: given.shape for given in session.get_inputs()} == {
        name: ["faces", *array.shape[1:]] for name, array in feed.items()
    }
    return feed


@pytest.mark.parametrize("name", ["auto", "cascade"])
def test_every_stage_gives_the_same_normals(name, tmp_path):
    assert run(["export-onnx", str(tmp_path / "out"), "--model", name]) == 0
    networks = shipped(name).networks
    assert len(list((tmp_path / "out").iterdir())) == sum(len(cascade.stages) for cascade in networks.values())
    for network, cascade in networks.items():
        same_normals(cascade, [tmp_path / "out" / f"{network}-stage{n}.onnx".removeprefix("-") for n in (1, 2, 3)])


def same_normals(cascade, files):
    mesh = ROUGH
    for stage, file in zip(cascade.stages, files, strict=True):
        session = onnxruntime.InferenceSession(file)
        assert json.loads(session.get_modelmeta().custom_metadata_map["stage"]) == asdict(stage.settings)
        stack = stage_stack(stage.settings, mesh, ROUGH)
        feed = inputs(session, stage, mesh, stack)
        (normals,) = session.run(["normals"], feed)
        np.testing.assert_allclose(normals, stage.normals(mesh, stack), atol=1e-5)
        (one,) = session.run(None, {name: array[:1] for name, array in feed.items()})  # the number of faces is free
        np.testing.assert_allclose(one, stage.normals(mesh, stack)[:1], atol=1e-5)
        mesh = apply_stage(stage, mesh, ROUGH)


def test_a_sum_that_vanishes_gives_the_first_normal():
    from cascadenorm.learned.onnx_export import stage_model

    stage = shipped("auto").surface.stages[0]
    stack = np.zeros((2, 21, 3), np.float32)
    (normals,) = onnxruntime.InferenceSession(stage_model(stage)).run(
        None, {"stack": stack, "context": np.zeros((2, 121), np.float32)}
    )
    assert not normals.any()


def test_files_are_replaced_only_with_force(tmp_path):
    assert run(["export-onnx", str(tmp_path)]) == 0
    before = (tmp_path / "vertex-stage2.onnx").read_bytes()
    assert run(["export-onnx", str(tmp_path)]) == 5
    assert run(["export-onnx", str(tmp_path), "--force"]) == 0
    assert (tmp_path / "vertex-stage2.onnx").read_bytes() == before
    with pytest.raises(cn.ParameterError):
        cn.Denoiser.load(tmp_path / "vertex-stage2.onnx")
