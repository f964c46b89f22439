"""Export the networks of a stage as an ONNX model."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import MissingDependencyError
from cascadenorm.learned.descriptors import DESCRIPTORS
from cascadenorm.learned.features import FLOOR
from cascadenorm.learned.regression import Regression

try:
    import onnx
    from onnx import TensorProto, helper, numpy_helper
except ImportError:
    raise MissingDependencyError("exporting to ONNX", package="onnx", extra="onnx") from None

OPSET = 17
IR_VERSION = 9


def stage_model(stage: Regression) -> bytes:
    """Return a stage as an ONNX model that computes `Regression.normals` up to rounding.

    The inputs are float32: stack (m, k, 3), the filtered normals of m faces (`stage_stack`, `unpacked`), and, if the
    stage has context features, context (m, c), the columns of `FeatureScaler.context`. The output is normals (m, 3),
    float32 unit vectors; where the weighted sum vanishes, the first filtered normal. m is a dynamic dimension.
    """
    graph = _Graph()
    features = _features(graph, stage)
    coefficients = _coefficients(graph, stage, features)
    normals = _weighted_sum(graph, coefficients)
    graph.add("Identity", [normals], output="normals")
    count, around = DESCRIPTORS[stage.settings.descriptor].size, stage.scaler.context_mean.size
    inputs = [helper.make_tensor_value_info("stack", TensorProto.FLOAT, ["faces", count, 3])]
    if around:
        inputs.append(helper.make_tensor_value_info("context", TensorProto.FLOAT, ["faces", around]))
    outputs = [helper.make_tensor_value_info("normals", TensorProto.FLOAT, ["faces", 3])]
    made = helper.make_graph(graph.nodes, "cascadenorm", inputs, outputs, graph.constants)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="cascadenorm")
    model.ir_version = IR_VERSION
    helper.set_model_props(model, {"stage": json.dumps(asdict(stage.settings), sort_keys=True)})
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString(deterministic=True))


class _Graph:
    """Nodes and constants of a graph, each with a unique name."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def add(self, operation: str, inputs: Sequence[str], *, output: str = "", **attributes: Any) -> str:
        """Add a node with one output; return the name of the output."""
        output = output or f"{operation.lower()}{len(self.nodes)}"
        self.nodes.append(helper.make_node(operation, list(inputs), [output], **attributes))
        return output

    def constant(self, values: Any, kind: Any = np.float32) -> str:
        """Add a constant; return its name."""
        name = f"constant{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.asarray(values, kind, order="C"), name))
        return name


def _features(graph: _Graph, stage: Regression) -> str:
    """Return the normalised features, (m, d + c): the pairs of filtered normals, then the context."""
    first, second = stage.scaler.pairs.T
    one = graph.add("Gather", ["stack", graph.constant(first, np.int64)], axis=1)
    other = graph.add("Gather", ["stack", graph.constant(second, np.int64)], axis=1)
    between = graph.add("Sub", [one, other])
    squared = graph.add("ReduceSum", [graph.add("Mul", [between, between]), graph.constant([2], np.int64)], keepdims=0)
    angles = graph.add("Add", [graph.add("Mul", [squared, graph.constant(0.5)]), graph.constant(FLOOR)])
    own = _scaled(graph, graph.add("Log", [angles]), stage.scaler.mean, stage.scaler.scale)
    if not stage.scaler.context_mean.size:
        return own
    around = _scaled(graph, "context", stage.scaler.context_mean, stage.scaler.context_scale)
    return graph.add("Concat", [own, around], axis=1)


def _scaled(graph: _Graph, values: str, mean: NDArray[np.float32], scale: NDArray[np.float32]) -> str:
    return graph.add("Mul", [graph.add("Sub", [values, graph.constant(mean)]), graph.constant(scale)])


def _coefficients(graph: _Graph, stage: Regression, features: str) -> str:
    """Return one coefficient per filtered normal, (m, k), from the network of the nearest centre."""
    parts = [_network(graph, stage, features, cluster) for cluster in range(len(stage.centers))]
    if len(parts) == 1:
        return parts[0]
    product = graph.add("MatMul", [features, graph.constant(-2 * stage.centers.T)])
    distance = graph.add("Add", [product, graph.constant((stage.centers**2).sum(axis=1))])
    nearest = graph.add("ArgMin", [distance], axis=1, keepdims=1)
    zero, total = graph.constant(0), ""
    for cluster, part in enumerate(parts):
        mine = graph.add("Equal", [nearest, graph.constant(cluster, np.int64)])
        kept = graph.add("Where", [mine, part, zero])
        total = graph.add("Add", [total, kept]) if total else kept
    return total


def _network(graph: _Graph, stage: Regression, values: str, cluster: int) -> str:
    for number, (weight, bias) in enumerate(stage.layers):
        if number:
            values = _activated(graph, stage.settings.activation, values)
        values = graph.add("Gemm", [values, graph.constant(weight[cluster]), graph.constant(bias[cluster])])
    return values


def _activated(graph: _Graph, activation: str, values: str) -> str:
    if activation == "tanh":
        return graph.add("Tanh", [values])
    return graph.add("Mul", [values, graph.add("Sigmoid", [values])])  # silu


def _weighted_sum(graph: _Graph, coefficients: str) -> str:
    """Return the sum of the filtered normals with these coefficients, normalised."""
    column = graph.add("Unsqueeze", [coefficients, graph.constant([1], np.int64)])
    axis, zero = graph.constant([1], np.int64), graph.constant(0)
    total = graph.add("Squeeze", [graph.add("MatMul", [column, "stack"]), axis])
    length = graph.add("ReduceL2", [total], axes=[1], keepdims=1)
    first = graph.add("Gather", ["stack", graph.constant(0, np.int64)], axis=1)
    moved = graph.add("Greater", [length, zero])
    divisor = graph.add("Where", [moved, length, graph.constant(1)])
    return graph.add("Where", [moved, graph.add("Div", [total, divisor]), first])
