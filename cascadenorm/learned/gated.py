"""The cascades of `auto`, and the gates that choose between them per component."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from os import PathLike, fspath
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from cascadenorm.detection.gate import ComponentKinds, Gate, Treatment, component_kinds
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.noise_evidence import component_angles, noise_evidence, turning_angles
from cascadenorm.learned.second_gate import SecondGate, first_normals
from cascadenorm.learned.weights import Arrays, packed, unpacked
from cascadenorm.mesh import Bools, Mesh, Vectors, with_part_moved
from cascadenorm.registry import ParameterError

GATED_FORMATS = (
    "cascadenorm-gated/5", "cascadenorm-gated/4", "cascadenorm-gated/3", "cascadenorm-gated/2", "cascadenorm-gated/1",
)  # fmt: skip
"""Formats of weights files. The first one is written; the others have no second gate, and those before 4 no network for
strong noise. Cascades within them have a format in CASCADE_FORMATS."""
STRONG_NOISE = np.radians(6.0)
"""Smallest mean angle by which the first stage of the vertex network turns the faces of a component with strong noise.
Noise of 0.08 mean edge lengths reaches it."""


@dataclass(frozen=True)
class GatedCascades:
    """The model of the method `auto`."""

    vertex: Cascade  # network for vertex noise
    surface: Cascade  # network for measured surfaces: errors of volumes, scanners, cameras and point clouds
    gate: Gate  # chooses between the networks from the triangulation
    gate_card: Mapping[str, Any]  # how the gate was trained; any JSON value
    # network for strong vertex noise, which begins with the first stage of the vertex network, if there is one
    strong: Cascade | None = None
    # recognises measured surfaces on which the vertex network finds hardly any noise, if there is one
    second_gate: Gate | None = None

    @property
    def card(self) -> dict[str, Any]:
        """Model cards of the parts, by name."""
        return {**{name: network.card for name, network in self.networks.items()}, "gate": self.gate_card}

    @property
    def networks(self) -> dict[str, Cascade]:
        """The networks by name."""
        strong = {} if self.strong is None else {"strong": self.strong}
        return {"vertex": self.vertex, "surface": self.surface, **strong}

    def component_kinds(self, mesh: Mesh, treat_as: Treatment | None = None) -> ComponentKinds:
        """Classify each component of a mesh by the gate, or all of them as `treat_as`."""
        if treat_as is None:
            return self._detected_kinds(mesh)
        probability = float(treat_as != "vertex-noise")
        count = mesh.topology.component_count
        return ComponentKinds(np.full(count, probability == 1), np.full(count, probability))

    def _detected_kinds(self, mesh: Mesh) -> ComponentKinds:
        known = _known.get(mesh)
        if known is None or known[0] is not self:
            second = None
            if self.second_gate is not None:
                second = SecondGate(self.second_gate, self.vertex.stages[0], self.surface.stages[0])
            known = _known[mesh] = self, component_kinds(self.gate, mesh, second)
        return known[1]

    def vertices(self, mesh: Mesh) -> Vectors:
        """Return the denoised vertices, (n, 3), using the network that the gate chooses for each component."""
        measured, impulsive = self.component_kinds(mesh).measured, np.zeros(len(mesh.vertices), bool)
        return self.chosen(measured, impulsive).vertices(mesh)

    def chosen(self, measured: Bools, impulsive: Bools) -> "ChosenNetworks":
        """Return the networks with the components and vertices to apply them to, as in `ChosenNetworks`."""
        return ChosenNetworks(self.vertex, self.surface, measured, impulsive, self.strong)

    def to_bytes(self) -> bytes:
        """Return the content of a weights file. Equal models have equal bytes."""
        parts = {name: network.tensors() for name, network in self.networks.items()} | {"gate": self.gate.arrays()}
        if self.second_gate is not None:
            parts["second_gate"] = self.second_gate.arrays()
        tensors: Arrays = {f"{part}.{name}": a for part, arrays in parts.items() for name, a in arrays.items()}
        for name in self.vertex.stages[0].arrays():
            tensors.pop(f"strong.stage0.{name}", None)  # the same as in the vertex network
        headers = {name: network.header() for name, network in self.networks.items()}
        return packed({"format": GATED_FORMATS[0], **headers, "gate": self.gate_card}, tensors)

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], tensors: Arrays, source: str) -> "GatedCascades":
        """Rebuild a model from its header and its arrays. Raises the errors of `Cascade.from_parts`."""
        vertex, surface, strong = (_under(tensors, part) for part in ("vertex", "surface", "strong"))
        gate, second_gate = (_under(tensors, part) for part in ("gate", "second_gate"))
        return cls(
            Cascade.from_parts(header["vertex"], vertex, source),
            Cascade.from_parts(header["surface"], surface, source),
            Gate.from_arrays(gate),
            header["gate"],
            Cascade.from_parts(header["strong"], {**vertex, **strong}, source) if "strong" in header else None,
            Gate.from_arrays(second_gate) if second_gate else None,
        )


_known: WeakKeyDictionary[Mesh, tuple[GatedCascades, ComponentKinds]] = WeakKeyDictionary()
"""The last classification of each mesh, which `auto` and the summary of its result both need."""


class ChosenNetworks(NamedTuple):
    """The networks of `auto`, and where they apply."""

    vertex: Cascade
    surface: Cascade
    measured: Bools  # (c,) components that are treated as measured surfaces
    impulsive: Bools  # (n,) vertices of components with impulsive noise
    strong: Cascade | None = None  # continues the vertex network on components with strong noise

    def vertices(self, mesh: Mesh) -> Vectors:
        """Return the denoised vertices, (n, 3), of a mesh with these components."""
        measured = self.measured[mesh.topology.face_components]
        if measured.any():
            surface = partial(_denoised, self.surface, strong=None, white=False)
            mesh = mesh.moved(with_part_moved(mesh, measured, surface, self.impulsive))
        vertex = partial(_denoised, self.vertex, strong=self.strong, white=True)
        return with_part_moved(mesh, ~measured, vertex, self.impulsive)


def _denoised(network: Cascade, mesh: Mesh, impulsive: Bools, *, strong: Cascade | None, white: bool) -> Vectors:
    """Return the vertices, (n, 3), that a network denoises, as far as there is evidence for noise.

    Outliers count as evidence; `white` is that of `noise_evidence`. The later stages skip components without
    evidence. If there is a network for strong noise, its stages replace them on components that the first stage turns
    by STRONG_NOISE or more.
    """
    topology = mesh.topology
    normals = first_normals(network.stages[0], mesh)
    angles = turning_angles(mesh, normals)
    evidence = np.maximum(noise_evidence(mesh, angles, white=white), impulsive)
    noisy = np.isin(topology.face_components, topology.components[evidence > 0])
    parts = [(network, noisy)]
    if strong is not None:
        strongly = noisy & (component_angles(mesh, angles) >= STRONG_NOISE)[topology.face_components]
        parts = [(strong, strongly), (network, noisy & ~strongly)]
    parts = [(cascade, part) for cascade, part in parts if part.any()]
    known = [[normals if part.all() else normals[part]] for _, part in parts]
    del normals, angles  # frees memory for the networks; the cascades release their rows after the first stage
    denoised = mesh
    for (cascade, part), theirs in zip(parts, known, strict=True):
        denoised = denoised.moved(with_part_moved(denoised, part, partial(cascade.vertices, known=theirs)))
    return evidence[:, None] * denoised.vertices + (1 - evidence[:, None]) * mesh.vertices


def _under(tensors: Arrays, part: str) -> Arrays:
    """Return the arrays of a part by their names within it."""
    return {name.removeprefix(f"{part}."): a for name, a in tensors.items() if name.startswith(f"{part}.")}


def read_model(path: str | PathLike[str]) -> Cascade | GatedCascades:
    """Read a weights file with one cascade, or with those of `auto` and a gate.

    Raises ParameterError if the file is missing, or its model needs other filters than those of this version.
    """
    header, tensors = unpacked(path)
    if header.get("format") not in GATED_FORMATS:
        return Cascade.load(path)
    try:
        return GatedCascades.from_parts(header, tensors, fspath(path))
    except (KeyError, TypeError) as error:
        raise ParameterError(f"{fspath(path)} lacks {error}: make it again with `cascadenorm train-gate`") from None
