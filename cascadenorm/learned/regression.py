"""One stage of the cascade at run time: nearest cluster centre, that cluster's network, the true normal."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cascadenorm.learned.descriptors import DESCRIPTORS, Stack, pose_free, ring_means
from cascadenorm.mesh import Mesh, Vectors, unit

Array = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class Standard:
    """How what is known of a face becomes numbers of mean 0 and deviation 1.

    Parameters
    ----------
    mean, scale : (d,) of the pose-free descriptor x: (x - mean) * scale
    projection : (d, p) main directions of these numbers; their ring means are the context of the face
    context_mean, context_scale : (4 p,) of the context
    """

    mean: Array
    scale: Array
    projection: Array
    context_mean: Array
    context_scale: Array

    def numbers(self, stack: Stack, mesh: Mesh) -> Array:
        """Describe each face by its own filtered normals, and by the mean of the same over its surroundings.

        Parameters
        ----------
        stack : (m, k, 3) filtered normals of all faces of the mesh

        Returns
        -------
        (m, d + 4 p)
        """
        own: Array = (pose_free(stack) - self.mean) * self.scale
        main: Array = own @ self.projection
        context = (ring_means(main, mesh) - self.context_mean) * self.context_scale
        return np.concatenate([own, context], axis=1)


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Per-cluster networks with one hidden layer, from the descriptor of a face to its normal.

    A network puts out one coefficient for each filtered normal of the face; their weighted sum, at unit length, is
    the answer, which therefore turns with the mesh.

    Parameters
    ----------
    descriptor : which filtered normals it reads, a name in DESCRIPTORS
    standard : what brings them to the numbers that centres and networks take
    centers : (c, d) cluster centres
    weight1, bias1 : (c, d, h) and (c, h), hidden layer, tanh
    weight2, bias2 : (c, h, k) and (c, k), coefficients of the k normals
    """

    descriptor: str
    standard: Standard
    centers: Array
    weight1: Array
    bias1: Array
    weight2: Array
    bias2: Array

    def arrays(self) -> dict[str, Array]:
        """Return all arrays by name, as `from_arrays` takes them."""
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("descriptor", "standard")}
        return own | {f.name: getattr(self.standard, f.name) for f in fields(self.standard)}

    @classmethod
    def from_arrays(cls, descriptor: str, arrays: dict[str, Array]) -> "Regression":
        """Rebuild a regression from what `arrays` returned."""
        standard = Standard(**{f.name: arrays[f.name] for f in fields(Standard)})
        own = {f.name: arrays[f.name] for f in fields(cls) if f.name not in ("descriptor", "standard")}
        return cls(descriptor=descriptor, standard=standard, **own)

    def normals(self, mesh: Mesh, noisy: Mesh) -> Vectors:
        """Regress the true normal of each face.

        Parameters
        ----------
        mesh : m faces, as the stage before left them
        noisy : the same faces as they came; for the first stage the same mesh

        Returns
        -------
        (m, 3) float64, unit; where the weighted sum vanishes, the normal of the face in `mesh`
        """
        stack = stage_stack(self.descriptor, mesh, noisy)
        total = np.empty((len(stack), 3))
        with threadpool_limits(1):  # so that the bytes of a product do not depend on the number of threads
            x = self.standard.numbers(stack, mesh)
            cluster = nearest(x, self.centers)
            for c in range(len(self.centers)):
                mine = cluster == c
                hidden = np.tanh(x[mine] @ self.weight1[c] + self.bias1[c])
                coefficients = hidden @ self.weight2[c] + self.bias2[c]
                total[mine] = np.einsum("mk,mkd->md", coefficients, stack[mine])
        return unit(total, otherwise=stack[:, 0])


def stage_stack(descriptor: str, mesh: Mesh, noisy: Mesh) -> Stack:
    """Filter the normals of a mesh for a stage; one after the first also sees the noisy normals, last in the stack."""
    stack = DESCRIPTORS[descriptor](mesh)
    if mesh is noisy:
        return stack
    return np.concatenate([stack, noisy.normals[:, None].astype(np.float32)], axis=1)


def nearest(x: Array, centers: Array) -> NDArray[np.intp]:
    """Return the number of the nearest centre of each row."""
    return np.asarray(np.argmin((centers**2).sum(axis=1) - 2 * x @ centers.T, axis=1))
