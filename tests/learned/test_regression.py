"""A stage computes what its networks say, turns with the mesh, and does so in blocks that no thread changes."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from shapes import icosphere, noisy
from stages import random_regression

from cascadenorm.compute.threads import BLOCK
from cascadenorm.learned.packed_normals import unpacked
from cascadenorm.learned.regression import stage_stack
from cascadenorm.learned.training.network_training import Network
from cascadenorm.mesh import Mesh, in_blocks, limit_threads

MESH = noisy(icosphere(2), 0.2)
TURN = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()


@pytest.mark.parametrize("activation", ["tanh", "silu"])
def test_array_path_equals_torch(activation):
    stage = random_regression("B+G", activation=activation)
    packed = stage_stack(stage.settings, MESH, MESH)
    stack = unpacked(packed)
    x = stage.scaler.features(stack, stage.scaler.context(packed, MESH).of())
    stage = replace(stage, centers=x[[0, 9, 99]])
    distances = np.linalg.norm(x[:, None] - stage.centers, axis=2)
    expected = np.empty((len(x), 3))
    for c in range(len(stage.centers)):
        network = Network([x.shape[1], 7, 5, stack.shape[1]], activation, torch.Generator())
        with torch.no_grad():
            for layer, (weight, bias) in zip(network.layers, stage.layers, strict=True):
                layer.weight.copy_(torch.from_numpy(weight[c].T))
                layer.bias.copy_(torch.from_numpy(bias[c]))
            mine = distances.argmin(axis=1) == c
            expected[mine] = network(torch.from_numpy(x[mine]), torch.from_numpy(stack[mine])).numpy()
    assert len(np.unique(distances.argmin(axis=1))) > 1
    np.testing.assert_allclose(stage.normals(MESH, packed), expected, atol=1e-5)


@pytest.mark.parametrize("descriptor", ["B", "iterated-16+smoothed"])
def test_regression_turns_with_the_mesh(descriptor):
    stage = random_regression(descriptor)
    before = MESH.moved(0.9 * MESH.vertices + 0.1 * icosphere(2).vertices)
    turned, turned_before = (Mesh(m.vertices @ TURN.T, m.faces) for m in (MESH, before))
    expected = stage.normals(before, stage_stack(stage.settings, before, MESH)) @ TURN.T
    found = stage.normals(turned_before, stage_stack(stage.settings, turned_before, turned))
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_blocks_cover_all_and_do_not_depend_on_the_threads():
    count = 2 * BLOCK + 3
    ends = [683, 1367, 2051]  # a block of three rows would be so small that BLAS rounds otherwise
    wanted = [[row, ends[np.searchsorted(ends, row, "right")]] for row in range(count)]
    for threads in (1, 3):
        with limit_threads(threads):
            found = in_blocks(count, lambda start, stop: np.array([[row, stop] for row in range(start, stop)]))
            assert found.tolist() == wanted
