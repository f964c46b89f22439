"""One stage of the cascade at run time.

The network of the nearest cluster centre predicts the true normal of a face.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.elementary import expf
from cascadenorm.learned.descriptors import DESCRIPTORS, Stack
from cascadenorm.learned.features import Array, ComponentSums, FeatureScaler, all_pairs, by_filter, padded
from cascadenorm.learned.packed_normals import PackedNormals, no_normals, unpacked
from cascadenorm.learned.stage import Activation, Stage
from cascadenorm.mesh import Floats32, Mesh, Vectors, in_blocks, kernel, one_blas_thread, unit


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Networks, one per cluster, that map the descriptor of a face to its normal.

    A network predicts one coefficient for each filtered normal of the face. The result is their weighted sum,
    normalised, which therefore rotates with the mesh.
    """

    settings: Stage  # descriptor of the stage, and settings of the vertex update
    scaler: FeatureScaler  # normalisation of the features for centres and networks
    centers: Array  # (c, d) cluster centres
    # Weights (c, i, o) and biases (c, o) of each layer. The first layer has d inputs, the last one outputs the
    # coefficients of the k normals.
    layers: tuple[tuple[Array, Array], ...]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by name, as `from_arrays` expects them."""
        layers = {
            f"{name}{number}": array
            for number, layer in enumerate(self.layers, 1)
            for name, array in zip(("weight", "bias"), layer, strict=True)
        }
        scaler = {f.name: getattr(self.scaler, f.name) for f in fields(FeatureScaler)}
        return {"centers": self.centers, **layers, **scaler}

    @classmethod
    def from_arrays(cls, settings: Stage, arrays: dict[str, NDArray[Any]]) -> "Regression":
        """Rebuild a regression from the result of `arrays`. Raises KeyError if an array is missing.

        Weights without pairs, of older formats, read those of all filtered normals.
        """
        arrays = {"pairs": all_pairs(DESCRIPTORS[settings.descriptor].size), **arrays}
        count = max(1, sum(name.startswith("weight") for name in arrays))
        return cls(
            settings=settings,
            scaler=FeatureScaler(**{f.name: arrays[f.name] for f in fields(FeatureScaler)}),
            centers=arrays["centers"],
            layers=tuple((arrays[f"weight{n}"], arrays[f"bias{n}"]) for n in range(1, count + 1)),
        )

    def normals(self, mesh: Mesh, stack: PackedNormals, sums: ComponentSums | None = None) -> Vectors:
        """Regress the true normal of each face of a mesh after the previous stage, (m, 3) float64 unit vectors.

        The stack, (m, k, 3), is the result of `stage_stack` for this mesh. The sums over connected components, from
        `FeatureScaler.sums`, are those of a larger mesh of which this one is a part; None computes them from the mesh.
        Where the weighted sum vanishes, the first filtered normal is returned.
        """
        return unit(self._all_sums(mesh, stack, sums), otherwise=unpacked(stack[:, :1])[:, 0])

    def _all_sums(self, mesh: Mesh, stack: PackedNormals, sums: ComponentSums | None) -> Array:
        """Return the weighted sums of the normals of each face, (m, 3). The context is released on return."""
        with one_blas_thread():  # the blocks already run on several threads
            context = self.scaler.context(stack, mesh, sums)

            def totals(start: int, stop: int) -> Array:
                some = unpacked(stack[start:stop])
                coefficients = self._coefficients(self.scaler.features(some, context.of(slice(start, stop))))
                return _weighted_sums(coefficients, some)

            return in_blocks(len(stack), totals)

    def _coefficients(self, x: Array) -> Array:
        """Return the coefficients of the normals of faces with features x, (m, k), from the network of each cluster."""
        if len(self.centers) == 1:
            return self._of_cluster(0, padded(x))[: len(x)]
        cluster = nearest(x, self.centers)
        coefficients = np.empty((len(x), self.layers[-1][0].shape[-1]), np.float32)
        for c in range(len(self.centers)):
            mine = np.flatnonzero(cluster == c)
            coefficients[mine] = self._of_cluster(c, x.T.take(mine, axis=1).T)  # x.T is contiguous
        return coefficients

    def _of_cluster(self, cluster: int, x: Array) -> Array:
        """Apply the network of a cluster."""
        *hidden, last = self.layers
        for weight, bias in hidden:
            x = x @ weight[cluster]
            _ACTIVATIONS[self.settings.activation](x, bias[cluster])
        weight, bias = last
        return np.asarray(x @ weight[cluster] + bias[cluster])


def _weighted_sums(coefficients: Array, stack: Stack) -> Array:
    """Sum the normals of each face weighted by its coefficients, (m, k), to (m, 3)."""
    out = np.zeros((3, len(stack)), np.float32)
    _add_weighted(np.ascontiguousarray(coefficients.T), by_filter(stack), out)
    return out.T


def stage_stack(settings: Stage, mesh: Mesh, noisy: Mesh) -> PackedNormals:
    """Filter the normals of a mesh for a stage, (m, k, 3)."""
    descriptor = DESCRIPTORS[settings.descriptor]
    stack = no_normals(len(mesh.faces), descriptor.size)
    descriptor.fill(stack, mesh, noisy)
    return stack


def nearest(x: Array, centers: Array) -> NDArray[np.intp]:
    """Return the index of the nearest centre of each row."""
    return np.asarray(np.argmin((centers**2).sum(axis=1) - 2 * x @ centers.T, axis=1))


@kernel
def _add_weighted(coefficients: Floats32, normals: Floats32, out: Floats32) -> None:
    """Add coefficients[k, f] · normals[k, :, f] to out[:, f] for all k."""
    for k in range(len(normals)):
        for d in range(3):
            factors, values, sums = coefficients[k], normals[k, d], out[d]
            for f in range(len(sums)):
                sums[f] += factors[f] * values[f]


def _tanh(x: Floats32, bias: Floats32) -> None:
    x += bias
    np.tanh(x, out=x)


@kernel
def _silu(x: Floats32, bias: Floats32) -> None:
    """Replace x by y / (1 + e^-y) with y = x + bias."""
    for i in range(len(x)):
        for j in range(x.shape[1]):
            y = x[i, j] + bias[j]
            x[i, j] = y / (np.float32(1) + expf(-y))


_ACTIVATIONS: dict[Activation, Callable[[Floats32, Floats32], None]] = {"tanh": _tanh, "silu": _silu}
"""Activation functions between the layers, computed in place from x and bias."""
