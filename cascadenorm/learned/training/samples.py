"""Training meshes before the next stage, and their training targets."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cascadenorm.learned.cascade import apply_stage
from cascadenorm.learned.descriptors import Stack
from cascadenorm.learned.features import Array, FeatureScaler
from cascadenorm.learned.packed_normals import unpacked
from cascadenorm.learned.regression import Regression, stage_stack
from cascadenorm.learned.stage import Stage
from cascadenorm.mesh import Ints32, Mesh, Vectors


@dataclass
class Sample:
    """A training mesh, noisy and after the finished stages, with the drawn faces and their true normals.

    Only positions are kept. Derived arrays need ten times the memory and are recomputed when needed.
    """

    index: int  # of its pair; given pairs follow the generated ones
    faces: Ints32
    noisy: Vectors
    truth: Array
    rows: NDArray[np.intp]
    vertices: Vectors | None = None  # vertices after the finished stages; None before the first stage

    @classmethod
    def drawn(cls, index: int, noisy: Vectors, faces: Ints32, normals: Vectors, *, count: int, seed: int) -> "Sample":
        """Draw at most `count` of the faces whose true normal is known, that is, not zero."""
        whole = np.flatnonzero(normals.any(axis=1))
        rows = np.sort(np.random.default_rng((seed, index)).choice(whole, min(count, len(whole)), replace=False))
        return cls(index, faces, noisy, normals[rows].astype(np.float32), rows)

    def meshes(self) -> tuple[Mesh, Mesh]:
        """Return the mesh before the next stage and the noisy mesh. They are the same before the first stage."""
        noisy = Mesh(self.noisy, self.faces)
        return (noisy if self.vertices is None else noisy.moved(self.vertices)), noisy

    def stack(self, settings: Stage) -> Stack:
        """Return the filtered normals of the drawn faces."""
        return unpacked(stage_stack(settings, *self.meshes())[self.rows])

    def described(self, settings: Stage, scaler: FeatureScaler) -> tuple[Stack, Array]:
        """Return the filtered normals of the drawn faces and their context features, (rows, c)."""
        mesh, noisy = self.meshes()
        stack = stage_stack(settings, mesh, noisy)
        return unpacked(stack[self.rows]), scaler.context(stack, mesh).of(self.rows)

    def apply_stage(self, stage: Regression) -> Vectors:
        """Return the vertices after a stage."""
        return apply_stage(stage, *self.meshes()).vertices
