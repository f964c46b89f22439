"""The gate: from how the triangles of each component lie to the network that treats it."""

from dataclasses import dataclass, fields
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.detection.segmentation_steps import is_segmentation
from cascadenorm.detection.triangulation import FIGURES, triangulation_figures
from cascadenorm.mesh import Bools, Floats, Floats32, Ints32, Mesh, part_of

Treatment = Literal["vertex-noise", "measured-surface"]
"""What a component is treated as. `vertex-noise`: a shape whose vertices may carry noise. `measured-surface`: what
volumes, scanners, cameras and point clouds leave."""

THRESHOLD = 0.6
"""Probability of a measured surface from which a component is treated as one."""
REPEATED = 0.5
"""Share of the 16 most frequent shapes of triangles from which a closed component may be the surface of a binary mask.
Parts with sides along the lattice of the mask look tessellated to the trees."""
SMALL_SHARE = 0.005
"""Components with a smaller share of the faces of the mesh are judged together."""


@dataclass(frozen=True)
class Gate:
    """A forest of decision trees as plain arrays (Geurts, Ernst, Wehenkel 2006).

    Parameters
    ----------
    roots
        (t,) number of the first node of each tree.
    figures
        (k,) figure that a node compares, -1 at a leaf.
    limits
        (k,) values up to which a node leads to its lower child.
    children
        (k, 2) numbers of the lower and the upper child.
    shares
        (k,) share of measured surfaces at a leaf.
    """

    roots: Ints32
    figures: Ints32
    limits: Floats32
    children: Ints32
    shares: Floats32

    def probability(self, figures: Floats) -> float:
        """Return the probability that a surface with such figures is a measured one."""
        nodes, given = self.roots, figures.astype(np.float32)
        while (inner := self.figures[nodes] >= 0).any():
            upper = given[self.figures[nodes]] > self.limits[nodes]
            nodes = np.where(inner, self.children[nodes, upper.astype(np.intp)], nodes)
        return float(self.shares[nodes].mean(dtype=np.float64))

    def arrays(self) -> dict[str, NDArray[np.float32] | NDArray[np.int32]]:
        """Return all arrays by name, as the constructor takes them."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


class Judged(NamedTuple):
    """What a gate says of the components of a mesh.

    Parameters
    ----------
    measured
        (c,) whether a component is treated as a measured surface; by the numbers of `Topology.components`.
    probabilities
        (c,) that it is one; NaN for vertices without a face.
    """

    measured: Bools
    probabilities: Floats


def judged(gate: Gate, mesh: Mesh) -> Judged:
    """Judge each connected component of a mesh; those with a share of the faces below SMALL_SHARE together.

    Closed components whose triangles repeat few shapes are also measured surfaces if they have the steps of a mask (see
    `is_segmentation`).
    """
    components = mesh.topology.face_components
    counts = np.bincount(components, minlength=int(mesh.topology.components.max()) + 1)
    small = counts < SMALL_SHARE * len(components)
    group = np.where(small, len(counts), np.arange(len(counts)))[components]
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    probabilities = np.full(len(counts) + 1, np.nan)
    for faces in np.split(order, starts[1:]):
        figures = triangulation_figures(mesh, faces)
        probability = gate.probability(figures)
        if probability < THRESHOLD and _is_mask(mesh, faces, figures):
            probability = 1.0
        probabilities[group[faces[0]]] = probability
    each = np.where(small & (counts > 0), probabilities[-1], probabilities[:-1])
    return Judged(each >= THRESHOLD, each)


def _is_mask(mesh: Mesh, faces: NDArray[np.intp], figures: Floats) -> bool:
    """Whether some faces of a mesh, with their figures, are the surface of a binary mask."""
    found = dict(zip(FIGURES, figures, strict=True))
    if found["open sides"] > 0 or found["most frequent 16 shapes"] < REPEATED:
        return False
    return is_segmentation(part_of(mesh, faces)[0])
