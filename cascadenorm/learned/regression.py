"""One stage of the cascade at run time: nearest cluster centre, that cluster's network, the true normal."""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.elementary import expf
from cascadenorm.learned.descriptors import DESCRIPTORS, Stack
from cascadenorm.learned.features import Array, ComponentSums, FeatureScaler
from cascadenorm.learned.stage import Activation, Stage
from cascadenorm.mesh import Floats32, Mesh, Vectors, in_blocks, kernel, one_blas_thread, unit


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Per-cluster networks, from the descriptor of a face to its normal.

    A network puts out one coefficient for each filtered normal of the face; their weighted sum, at unit length, is
    the answer, which therefore turns with the mesh.

    Parameters
    ----------
    settings
        What it reads, and how the vertices follow.
    scaler
        Normalises the features that centres and networks take.
    centers
        (c, d) cluster centres.
    layers
        Weights (c, i, o) and biases (c, o) of each layer; the first takes d features, the last gives the coefficients
        of the k normals.
    """

    settings: Stage
    scaler: FeatureScaler
    centers: Array
    layers: tuple[tuple[Array, Array], ...]

    def arrays(self) -> dict[str, Array]:
        """Return all arrays by name, as `from_arrays` takes them."""
        layers = {
            f"{name}{number}": array
            for number, layer in enumerate(self.layers, 1)
            for name, array in zip(("weight", "bias"), layer, strict=True)
        }
        scaler = {f.name: getattr(self.scaler, f.name) for f in fields(FeatureScaler)}
        return {"centers": self.centers, **layers, **scaler}

    @classmethod
    def from_arrays(cls, settings: Stage, arrays: dict[str, Array]) -> "Regression":
        """Rebuild a regression from what `arrays` returned; raises KeyError where one is missing."""
        count = max(1, sum(name.startswith("weight") for name in arrays))
        return cls(
            settings=settings,
            scaler=FeatureScaler(**{f.name: arrays[f.name] for f in fields(FeatureScaler)}),
            centers=arrays["centers"],
            layers=tuple((arrays[f"weight{n}"], arrays[f"bias{n}"]) for n in range(1, count + 1)),
        )

    def normals(self, mesh: Mesh, stack: Stack, sums: ComponentSums | None = None) -> Vectors:
        """Regress the true normal of each face.

        Parameters
        ----------
        mesh
            m faces, as the stage before left them.
        stack
            (m, k, 3) what `stage_stack` makes of them.
        sums
            Over connected components of the larger mesh of which it is a part, as `FeatureScaler.sums` gives them.

        Returns
        -------
        (m, 3) float64, unit; where the weighted sum vanishes, the first of the filtered normals
        """
        with one_blas_thread():  # the blocks are on several threads already
            context = self.scaler.context(stack, mesh, sums)

            def totals(start: int, stop: int) -> Array:
                rows = slice(start, stop)
                part = np.ascontiguousarray(stack[rows])
                return self._sums(part, self.scaler.features(part, context.of(rows)))

            total = in_blocks(len(stack), totals)
        return unit(total, otherwise=stack[:, 0])

    def _sums(self, stack: Stack, x: Array) -> Array:
        """Return the weighted sums of the normals of some faces, which x describes, (m, 3)."""
        if len(self.centers) == 1:
            return _weighted_sums(self._coefficients(0, x), stack)
        cluster = nearest(x, self.centers)
        total = np.empty((len(stack), 3), np.float32)
        for c in range(len(self.centers)):
            mine = cluster == c
            total[mine] = _weighted_sums(self._coefficients(c, x[mine]), stack[mine])
        return total

    def _coefficients(self, cluster: int, x: Array) -> Array:
        """Apply the network of a cluster."""
        *hidden, last = self.layers
        for weight, bias in hidden:
            x = x @ weight[cluster]
            _ACTIVATIONS[self.settings.activation](x, bias[cluster])
        weight, bias = last
        return np.asarray(x @ weight[cluster] + bias[cluster])


def _weighted_sums(coefficients: Array, stack: Stack) -> Array:
    """Add the normals of each face by its coefficients, (m, k): (m, 3)."""
    out = np.empty((len(stack), 3), np.float32)
    _add_weighted(coefficients, stack, out)
    return out


def stage_stack(settings: Stage, mesh: Mesh, noisy: Mesh) -> Stack:
    """Filter the normals of a mesh for a stage, (m, k, 3).

    In memory it is (k, m, 3): so a filter writes what it keeps in a third of the time.
    """
    descriptor = DESCRIPTORS[settings.descriptor]
    stack = np.empty((descriptor.size, len(mesh.faces), 3), np.float32).transpose(1, 0, 2)
    descriptor.fill(stack, mesh, noisy, settings.neighborhood)
    return stack


def nearest(x: Array, centers: Array) -> NDArray[np.intp]:
    """Return the number of the nearest centre of each row."""
    return np.asarray(np.argmin((centers**2).sum(axis=1) - 2 * x @ centers.T, axis=1))


@kernel
def _add_weighted(coefficients: Floats32, stack: Floats32, out: Floats32) -> None:
    """Write the same as numpy's einsum, in a sixth of the time."""
    for f in range(len(out)):
        x = y = z = np.float32(0)
        for k in range(coefficients.shape[1]):
            x += coefficients[f, k] * stack[f, k, 0]
            y += coefficients[f, k] * stack[f, k, 1]
            z += coefficients[f, k] * stack[f, k, 2]
        out[f, 0], out[f, 1], out[f, 2] = x, y, z


def _tanh(x: Floats32, bias: Floats32) -> None:
    x += bias
    np.tanh(x, out=x)


@kernel
def _silu(x: Floats32, bias: Floats32) -> None:
    """y / (1 + e^-y), y = x + bias."""
    for i in range(len(x)):
        for j in range(x.shape[1]):
            y = x[i, j] + bias[j]
            x[i, j] = y / (np.float32(1) + expf(-y))


_ACTIVATIONS: dict[Activation, Callable[[Floats32, Floats32], None]] = {"tanh": _tanh, "silu": _silu}
"""What is between the layers of a network, computed in place of x from x and bias."""
