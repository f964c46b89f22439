"""The gate that selects a network for each component from its tessellation."""

from dataclasses import dataclass, fields
from typing import Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from cascadenorm.detection.segmentation_steps import is_segmentation
from cascadenorm.detection.triangulation import FIGURES, triangulation_figures
from cascadenorm.mesh import Bools, Floats, Floats32, Ints32, Mesh, part_of

Treatment = Literal["vertex-noise", "measured-surface", "unknown"]
"""Treatment of a component: `vertex-noise` for shapes whose vertices may be noisy, `measured-surface` for surfaces from
volumes, scanners, cameras and point clouds, `unknown` for meshes whose triangles do not show what they come from, such
as coarse copies."""

THRESHOLD = 0.6  # probability above which a component is treated as a measured surface
# The forest mistakes components with sides along the lattice of the mask for tessellated shapes.
REPEATED = 0.5  # fraction of triangles with the 16 most frequent shapes above which a closed component may be a mask
SMALL_SHARE = 0.005  # components with a smaller fraction of the faces of the mesh are classified together


@dataclass(frozen=True)
class Gate:
    """A forest of extremely randomised decision trees as plain arrays (Geurts, Ernst, Wehenkel 2006)."""

    roots: Ints32  # (t,) root node of each tree
    figures: Ints32  # (k,) index of the feature that each node compares; -1 at a leaf
    limits: Floats32  # (k,) threshold of each node; values up to it lead to the lower child
    children: Ints32  # (k, 2) lower and upper child of each node
    shares: Floats32  # (k,) fraction of measured surfaces at each leaf

    def probability(self, figures: Floats) -> float:
        """Return the probability that a surface with the given features is a measured one."""
        nodes, given = self.roots, figures.astype(np.float32)
        while (inner := self.figures[nodes] >= 0).any():
            upper = given[self.figures[nodes]] > self.limits[nodes]
            nodes = np.where(inner, self.children[nodes, upper.astype(np.intp)], nodes)
        return float(self.shares[nodes].mean(dtype=np.float64))

    def arrays(self) -> dict[str, Floats32 | Ints32]:
        """Return all arrays by the names of the constructor's parameters."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


class ComponentKinds(NamedTuple):
    """The classification of the components of `Topology.components` by a gate."""

    measured: Bools  # (c,) whether each component is treated as a measured surface
    probabilities: Floats  # (c,) probability that it is one; NaN for vertices without a face


_known: WeakKeyDictionary[Mesh, tuple[Gate, ComponentKinds]] = WeakKeyDictionary()
"""The last result of `component_kinds` for each mesh, which `auto` and the summary of its result both need."""


def component_kinds(gate: Gate, mesh: Mesh) -> ComponentKinds:
    """Classify each connected component of a mesh; small components (see SMALL_SHARE) are classified together.

    Closed components with few distinct triangle shapes also count as measured surfaces if they have the steps of a
    binary mask (see `is_segmentation`).
    """
    known = _known.get(mesh)
    if known is None or known[0] is not gate:
        known = _known[mesh] = gate, _classified(gate, mesh)
    return known[1]


def _classified(gate: Gate, mesh: Mesh) -> ComponentKinds:
    components = mesh.topology.face_components
    counts = np.bincount(components, minlength=mesh.topology.component_count)
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
    return ComponentKinds(each >= THRESHOLD, each)


def _is_mask(mesh: Mesh, faces: NDArray[np.intp], figures: Floats) -> bool:
    """Return whether some faces of a mesh, with the given features, are the surface of a binary mask."""
    found = dict(zip(FIGURES, figures, strict=True))
    if found["open sides"] > 0 or found["most frequent 16 shapes"] < REPEATED:
        return False
    return is_segmentation(part_of(mesh, faces)[0])
