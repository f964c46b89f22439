"""The meshes of a training as they stand before the coming stage, and what is asked of each of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cascadenorm.learned.cascade import apply_stage
from cascadenorm.learned.descriptors import Stack
from cascadenorm.learned.features import Array, FeatureScaler
from cascadenorm.learned.regression import Regression, stage_stack
from cascadenorm.learned.stage import Stage
from cascadenorm.mesh import Mesh, Vectors


@dataclass
class Sample:
    """A training mesh as it came and as it stands before the coming stage, with the faces drawn and their truth.

    Only positions are kept: what is derived from them takes ten times the memory, and is soon made again.
    """

    faces: NDArray[np.int32]
    noisy: Vectors
    truth: Array
    rows: NDArray[np.intp]
    vertices: Vectors | None = None
    """Behind the stages so far, if there was one."""

    @classmethod
    def drawn(
        cls, noisy: Vectors, faces: NDArray[np.int32], normals: Vectors, count: int, seed: Sequence[int]
    ) -> "Sample":
        """Draw at most so many faces of those whose true normal is known, which is not zero."""
        whole = np.flatnonzero(normals.any(axis=1))
        rows = np.sort(np.random.default_rng(seed).choice(whole, min(count, len(whole)), replace=False))
        return cls(faces, noisy, normals[rows].astype(np.float32), rows)

    def meshes(self) -> tuple[Mesh, Mesh]:
        """Return the mesh before the coming stage, and as it came; the same one before the first."""
        noisy = Mesh(self.noisy, self.faces)
        return (noisy if self.vertices is None else noisy.moved(self.vertices)), noisy

    def stack(self, settings: Stage) -> Stack:
        """Return the filtered normals of the faces drawn."""
        return stage_stack(settings, *self.meshes())[self.rows]

    def described(self, settings: Stage, scaler: FeatureScaler) -> tuple[Stack, Array]:
        """Return the filtered normals of the faces drawn, and their context, (rows, c)."""
        mesh, noisy = self.meshes()
        stack = stage_stack(settings, mesh, noisy)
        return stack[self.rows], scaler.context(stack, mesh).of(self.rows)

    def apply_stage(self, stage: Regression) -> Vectors:
        """Return where a stage moves the vertices."""
        return apply_stage(stage, *self.meshes()).vertices
