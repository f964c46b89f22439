"""What computes on a GPU, tried on each device that torch finds; without a GPU that is the processor."""

import subprocess
import sys

import numpy as np
import pytest
import torch
from damage import adversarial_mesh
from shapes import cube, icosphere, noisy
from test_learned import random_regression

import cascadenorm as cn
from cascadenorm.learned import torch_engine
from cascadenorm.learned.cascade import PROCESSOR, shipped
from cascadenorm.learned.descriptors import ITERATED_PASSES, ITERATED_SIGMA_R, LATER_ITERATED_PASSES
from cascadenorm.learned.regression import stage_stack
from cascadenorm.mesh import Mesh, angles_between, in_frame
from cascadenorm.registry import ParameterError

DEVICES = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
MESH = noisy(icosphere(3), 0.3)
ADVERSARIAL = [in_frame(Mesh(*adversarial_mesh(np.random.default_rng(seed))))[0] for seed in range(100)]


@pytest.fixture(params=DEVICES)
def engine(request, monkeypatch):
    """An engine that works in several parts even on small meshes."""
    monkeypatch.setattr(torch_engine, "ROWS", 100)
    return torch_engine.engine(request.param)


def iterated(engine, mesh, passes):
    return engine.filters.iterated_bilateral(mesh, sigma_r=ITERATED_SIGMA_R, passes=passes)


@pytest.mark.parametrize("passes", [LATER_ITERATED_PASSES, ITERATED_PASSES])
def test_filters_equal_those_of_the_processor(engine, passes):
    expected = iterated(PROCESSOR, MESH, passes)
    np.testing.assert_array_equal(iterated(engine, MESH, passes), expected)
    along = expected[:, 1]
    for sigma_r in (np.inf, 0.35):
        expected = PROCESSOR.filters.smoothed(MESH, along, (1, 2, 5), sigma_r=sigma_r)
        found = engine.filters.smoothed(MESH, along, (1, 2, 5), sigma_r=sigma_r)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("activation", ["tanh", "silu"])
def test_regression_equals_that_of_the_processor(engine, activation):
    stage = random_regression("iterated-16+smoothed", later=True, activation=activation)
    smooth = MESH.moved(0.9 * MESH.vertices + 0.1 * icosphere(3).vertices)
    stack = stage_stack(stage.settings, smooth, MESH)
    np.testing.assert_allclose(engine.regress(stage, smooth, stack), stage.normals(smooth, stack), atol=1e-5)


@pytest.mark.parametrize("weighting", ["heights", "angles"])
@pytest.mark.parametrize("foldovers", ["avoid", "ignore"])
def test_vertices_equal_those_of_the_processor(engine, weighting, foldovers):
    folded = noisy(cube(6), 1.0)
    for normals in (folded.normals, cube(6).normals):
        here, there = (
            each.recover(folded, normals, sweeps=5, weighting=weighting, foldovers=foldovers)
            for each in (PROCESSOR, engine)
        )
        np.testing.assert_allclose(there, here, atol=1e-12)


def test_adversarial_meshes_come_out_as_on_the_processor(engine):
    for mesh in ADVERSARIAL:
        for weighting in ("heights", "angles"):
            expected = PROCESSOR.recover(mesh, mesh.normals, sweeps=2, weighting=weighting)
            found = engine.recover(mesh, mesh.normals, sweeps=2, weighting=weighting)
            np.testing.assert_allclose(found, expected, atol=1e-12)
        if mesh.mean_edge_length > 0:
            expected = iterated(PROCESSOR, mesh, LATER_ITERATED_PASSES)
            np.testing.assert_array_equal(iterated(engine, mesh, LATER_ITERATED_PASSES), expected)
            along = expected[:, 1]
            smooth = PROCESSOR.filters.smoothed(mesh, along, (1, 4))
            np.testing.assert_array_equal(engine.filters.smoothed(mesh, along, (1, 4)), smooth)


@pytest.mark.parametrize("name", ["auto", "cascade"])
def test_each_stage_of_shipped_models_agrees(engine, name):
    mesh = before = noisy(cube(20), 0.3)
    model = shipped(name)
    for stage, after in zip(model.stages, model.steps(mesh), strict=True):
        stack = stage_stack(stage.settings, before, mesh)
        angles = np.degrees(angles_between(stage.normals(before, stack), engine.regress(stage, before, stack)))
        assert angles.mean() < 1e-5
        assert angles.max() < 1e-3
        before = after


@pytest.mark.parametrize("name", ["auto", "cascade"])
def test_shipped_models_agree(engine, name):
    mesh = noisy(cube(20), 0.2)  # more noise folds faces, from which the vertex update enlarges differences of rounding
    here, there = (mesh.moved(shipped(name).vertices(mesh, engine=each)) for each in (PROCESSOR, engine))
    assert np.degrees(angles_between(here.normals, there.normals)).mean() < 1e-4
    assert shipped(name).vertices(mesh, engine=engine).tobytes() == there.vertices.tobytes()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU")
def test_methods_run_on_a_gpu():
    for method in ("auto", "cascade"):
        here, there = (cn.denoise(MESH, method=method, device=device) for device in ("cpu", "cuda"))
        assert np.degrees(angles_between(here.normals, there.normals)).mean() < 1e-3


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_no_gpu_is_said_in_words():
    with pytest.raises(ParameterError, match=r"finds no GPU .* leave the device out"):
        cn.denoise(MESH, device="cuda")


def test_no_torch_is_said_in_words():
    code = """
import sys; sys.modules["torch"] = None
import cascadenorm as cn
try:
    cn.denoise([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], device="cuda")
except cn.MissingDependencyError as error:
    print(error)"""
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "needs torch" in said and 'pip install "cascadenorm[gpu]"' in said


def test_a_gpu_with_too_little_memory_is_a_memory_error():
    def too_much(device):
        raise torch.cuda.OutOfMemoryError("tried to allocate 80 GiB")

    with pytest.raises(MemoryError, match="80 GiB"):
        torch_engine._on(torch.device("cpu"), too_much)()
