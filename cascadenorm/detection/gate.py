"""The gate that selects a network for each component from its tessellation."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, NamedTuple

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
SECOND_THRESHOLD = 0.55  # the same for a second opinion
# The forest mistakes components with sides along the lattice of the mask for tessellated shapes.
REPEATED = 0.5  # fraction of triangles with the 16 most frequent shapes above which a closed component may be a mask
SMALL_SHARE = 0.005  # components with a smaller fraction of the faces of the mesh are classified together


@dataclass(frozen=True)
class Gate:
    """A forest of extremely randomised decision trees as plain arrays (Geurts, Ernst, Wehenkel 2006)."""

    roots: Ints32  # (t,) root node of each tree
    figures: NDArray[np.int8]  # (k,) index of the feature that each node compares; -1 at a leaf
    # (k,) threshold of each inner node, up to which values lead to its lower child, which is the next node; at a leaf,
    # the fraction of measured surfaces
    values: Floats32
    upper: Ints32  # (k,) upper child of each inner node

    def probability(self, figures: Floats) -> float:
        """Return the probability that a surface with the given features is a measured one."""
        nodes, given = self.roots, figures.astype(np.float32)
        while (inner := self.figures[nodes] >= 0).any():
            upper = given[self.figures[nodes]] > self.values[nodes]
            nodes = np.where(inner, np.where(upper, self.upper[nodes], nodes + 1), nodes)
        return float(self.values[nodes].mean(dtype=np.float64))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by the names of the constructor's parameters."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> "Gate":
        """Rebuild a gate from its arrays, also from those of older weights files, which list both children."""
        if "children" not in arrays:
            return cls(**arrays)
        values = np.where(arrays["figures"] < 0, arrays["shares"], arrays["limits"])
        return cls(arrays["roots"], arrays["figures"].astype(np.int8), values, arrays["children"][:, 1])


class ComponentKinds(NamedTuple):
    """The classification of the components of `Topology.components` by a gate."""

    measured: Bools  # (c,) whether each component is treated as a measured surface
    probabilities: Floats  # (c,) probability that it is one; NaN for vertices without a face


SecondOpinion = Callable[[Mesh, Sequence[NDArray[np.intp]]], Floats]
"""Returns the probability that each of several groups of faces of a mesh, given by their indices, is measured."""


def component_kinds(gate: Gate, mesh: Mesh, second_opinion: SecondOpinion | None = None) -> ComponentKinds:
    """Classify each connected component of a mesh; small components (see SMALL_SHARE) are classified together.

    Closed components with few distinct triangle shapes also count as measured surfaces if they have the steps of a
    binary mask (see `is_segmentation`). Other components count as measured if the second opinion says so.
    """
    components = mesh.topology.face_components
    counts = np.bincount(components, minlength=mesh.topology.component_count)
    small = counts < SMALL_SHARE * len(components)
    group = np.where(small, len(counts), np.arange(len(counts)))[components]
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    groups = np.split(order, starts[1:])
    found = np.array([_probability(gate, mesh, faces) for faces in groups])
    recognised = found >= THRESHOLD
    if second_opinion is not None and not recognised.all():
        others = np.flatnonzero(~recognised)
        second = second_opinion(mesh, [groups[k] for k in others])
        sure = second >= SECOND_THRESHOLD
        found[others[sure]], recognised[others[sure]] = second[sure], True

    measured, probabilities = np.zeros(len(counts) + 1, bool), np.full(len(counts) + 1, np.nan)
    numbers = group[order[starts]]
    measured[numbers], probabilities[numbers] = recognised, found
    of_component = np.where(small & (counts > 0), len(counts), np.arange(len(counts)))
    return ComponentKinds(measured[of_component], probabilities[of_component])


def _probability(gate: Gate, mesh: Mesh, faces: NDArray[np.intp]) -> float:
    """Return the probability that some faces of a mesh are a measured surface, 1 for a binary mask."""
    figures = triangulation_figures(mesh, faces)
    probability = gate.probability(figures)
    return 1.0 if probability < THRESHOLD and _is_mask(mesh, faces, figures) else probability


def _is_mask(mesh: Mesh, faces: NDArray[np.intp], figures: Floats) -> bool:
    """Return whether some faces of a mesh, with the given features, are the surface of a binary mask."""
    found = dict(zip(FIGURES, figures, strict=True))
    if found["open sides"] > 0 or found["most frequent 16 shapes"] < REPEATED:
        return False
    return is_segmentation(part_of(mesh, faces)[0])
