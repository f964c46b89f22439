"""One stage of the cascade at run time: nearest cluster centre, that cluster's network, the true normal."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from cascadenorm.learned.descriptors import DESCRIPTORS, FILTERS, Filters, Stack, openness, pose_free, surroundings
from cascadenorm.mesh import Mesh, Vectors, in_blocks, one_blas_thread, unit

Array = NDArray[np.float32]

ACTIVATIONS: dict[str, Callable[[Array], Array]] = {"tanh": np.tanh, "silu": lambda x: 0.5 * x * (1 + np.tanh(0.5 * x))}
"""What is between the layers of a network, by the name that settings and weights use."""


@dataclass(frozen=True, kw_only=True)
class Standard:
    """How what is known of a face becomes numbers of mean 0 and deviation 1.

    Parameters
    ----------
    mean, scale : (d,) of the pose-free descriptor x: (x - mean) * scale
    projection : (d, p) main directions of these numbers; their means around the face are its context, and how open
        the mesh is; nothing is where p is 0
    context_mean, context_scale : (5 p + 1,) of the context
    """

    mean: Array
    scale: Array
    projection: Array
    context_mean: Array
    context_scale: Array

    def context(self, stack: Stack, mesh: Mesh) -> list[Array]:
        """Average the main directions of the numbers around each face, and say how open the mesh is.

        Parameters
        ----------
        stack : (m, k, 3) filtered normals of all faces of the mesh

        Returns
        -------
        5 of (m, p), then (m, 1), not yet of mean 0 and deviation 1; (m, 0) alone where p is 0
        """
        if not self.projection.size:
            return [np.empty((len(stack), 0), np.float32)]
        around = surroundings(in_blocks(len(stack), lambda i, j: self._own(stack[i:j]) @ self.projection), mesh)
        return [*around, openness(mesh)[:, None]]

    def numbers(self, stack: Stack, context: Sequence[Array]) -> Array:
        """Describe faces by their filtered normals and their context.

        Parameters
        ----------
        stack, context : (m, k, 3) of any faces, and what `context` gave for them

        Returns
        -------
        (m, d + 5 p + 1), or (m, d) where p is 0
        """
        around = np.concatenate(context, axis=1)
        around -= self.context_mean
        around *= self.context_scale
        return np.concatenate([self._own(stack), around], axis=1)

    def _own(self, stack: Stack) -> Array:
        numbers = pose_free(stack)
        numbers -= self.mean
        numbers *= self.scale
        return numbers


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Per-cluster networks, from the descriptor of a face to its normal.

    A network puts out one coefficient for each filtered normal of the face; their weighted sum, at unit length, is
    the answer, which therefore turns with the mesh.

    Parameters
    ----------
    descriptor : which filtered normals it reads, a name in DESCRIPTORS
    activation : what is between the layers, a name in ACTIVATIONS
    standard : what brings them to the numbers that centres and networks take
    centers : (c, d) cluster centres
    layers : weights (c, i, o) and biases (c, o) of each layer; the first takes d numbers, the last gives the
        coefficients of the k normals
    """

    descriptor: str
    activation: str
    standard: Standard
    centers: Array
    layers: tuple[tuple[Array, Array], ...]

    def arrays(self) -> dict[str, Array]:
        """Return all arrays by name, as `from_arrays` takes them."""
        layers = {
            f"{name}{number}": array
            for number, layer in enumerate(self.layers, 1)
            for name, array in zip(("weight", "bias"), layer, strict=True)
        }
        standard = {f.name: getattr(self.standard, f.name) for f in fields(Standard)}
        return {"centers": self.centers, **layers, **standard}

    @classmethod
    def from_arrays(cls, descriptor: str, activation: str, arrays: dict[str, Array]) -> "Regression":
        """Rebuild a regression from what `arrays` returned; raises KeyError where one is missing."""
        count = max(1, sum(name.startswith("weight") for name in arrays))
        return cls(
            descriptor=descriptor,
            activation=activation,
            standard=Standard(**{f.name: arrays[f.name] for f in fields(Standard)}),
            centers=arrays["centers"],
            layers=tuple((arrays[f"weight{n}"], arrays[f"bias{n}"]) for n in range(1, count + 1)),
        )

    def normals(self, mesh: Mesh, stack: Stack) -> Vectors:
        """Regress the true normal of each face.

        Parameters
        ----------
        mesh : m faces, as the stage before left them
        stack : (m, k, 3) what `stage_stack` makes of them

        Returns
        -------
        (m, 3) float64, unit; where the weighted sum vanishes, the normal of the face in `mesh`
        """
        with one_blas_thread():  # the blocks are on several threads already
            context = self.standard.context(stack, mesh)

            def sums(start: int, stop: int) -> Array:
                rows = slice(start, stop)
                return self._sums(stack[rows], self.standard.numbers(stack[rows], [part[rows] for part in context]))

            total = in_blocks(len(stack), sums)
        return unit(total, otherwise=stack[:, 0])

    def _sums(self, stack: Stack, x: Array) -> Array:
        """Return the weighted sums of the normals of some faces, which x describes, (m, 3)."""
        cluster = nearest(x, self.centers)
        total = np.empty((len(stack), 3), np.float32)
        for c in range(len(self.centers)):
            mine = cluster == c
            total[mine] = np.einsum("mk,mkd->md", self._coefficients(c, x[mine]), stack[mine])
        return total

    def _coefficients(self, cluster: int, x: Array) -> Array:
        """Apply the network of a cluster."""
        for weight, bias in self.layers[:-1]:
            x = ACTIVATIONS[self.activation](x @ weight[cluster] + bias[cluster])
        weight, bias = self.layers[-1]
        return np.asarray(x @ weight[cluster] + bias[cluster])


def stage_stack(descriptor: str, mesh: Mesh, noisy: Mesh, filters: Filters = FILTERS) -> Stack:
    """Filter the normals of a mesh for a stage; one after the first also sees the noisy normals, last in the stack."""
    parts = DESCRIPTORS[descriptor](mesh, noisy, filters)
    if mesh is not noisy:
        parts.append(noisy.normals[:, None].astype(np.float32))
    return np.concatenate(parts, axis=1)


def nearest(x: Array, centers: Array) -> NDArray[np.intp]:
    """Return the number of the nearest centre of each row."""
    return np.asarray(np.argmin((centers**2).sum(axis=1) - 2 * x @ centers.T, axis=1))
