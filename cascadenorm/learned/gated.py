"""Two cascades and the gate that chooses between them per component."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from os import PathLike, fspath
from typing import Any, NamedTuple

import numpy as np

from cascadenorm.detection.gate import ComponentKinds, Gate, Treatment, component_kinds
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.noise_evidence import noise_evidence, turning_angles
from cascadenorm.learned.stage_normals import stage_normals
from cascadenorm.learned.weights import Arrays, packed, unpacked
from cascadenorm.mesh import Bools, Mesh, Vectors, with_part_moved
from cascadenorm.registry import ParameterError

GATED_FORMATS = ("cascadenorm-gated/3", "cascadenorm-gated/2", "cascadenorm-gated/1")
"""Formats of weights files. The first one is written. Cascades within them have a format in CASCADE_FORMATS."""


@dataclass(frozen=True)
class GatedCascades:
    """The model of the method `auto`."""

    vertex: Cascade  # network for vertex noise
    surface: Cascade  # network for measured surfaces: errors of volumes, scanners, cameras and point clouds
    gate: Gate  # chooses between the networks from the triangulation
    gate_card: Mapping[str, Any]  # how the gate was trained; any JSON value

    @property
    def card(self) -> dict[str, Any]:
        """Model cards of the parts, by name."""
        return {"vertex": self.vertex.card, "surface": self.surface.card, "gate": self.gate_card}

    @property
    def networks(self) -> dict[str, Cascade]:
        """Both networks by name."""
        return {"vertex": self.vertex, "surface": self.surface}

    def component_kinds(self, mesh: Mesh, treat_as: Treatment | None = None) -> ComponentKinds:
        """Judge each component of a mesh, or treat all of them alike."""
        if treat_as is None:
            return component_kinds(self.gate, mesh)
        probability = float(treat_as != "vertex-noise")
        count = int(mesh.topology.components.max()) + 1
        return ComponentKinds(np.full(count, probability == 1), np.full(count, probability))

    def vertices(self, mesh: Mesh) -> Vectors:
        """Return the denoised vertices, (n, 3), using the network that the gate chooses for each component."""
        measured, impulsive = self.component_kinds(mesh).measured, np.zeros(len(mesh.vertices), bool)
        return ChosenNetworks(self.vertex, self.surface, measured, impulsive).vertices(mesh)

    def to_bytes(self) -> bytes:
        """Return the content of a weights file. Equal models have equal bytes."""
        parts = {"vertex": self.vertex.tensors(), "surface": self.surface.tensors(), "gate": self.gate.arrays()}
        tensors: Arrays = {f"{part}.{name}": a for part, arrays in parts.items() for name, a in arrays.items()}
        headers = {"vertex": self.vertex.header(), "surface": self.surface.header(), "gate": self.gate_card}
        return packed({"format": GATED_FORMATS[0], **headers}, tensors)

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], tensors: Arrays, source: str) -> "GatedCascades":
        """Rebuild a model from its header and its arrays. The errors are those of `Cascade.from_parts`."""
        vertex, surface, gate = (_under(tensors, part) for part in ("vertex", "surface", "gate"))
        return cls(
            Cascade.from_parts(header["vertex"], vertex, source),
            Cascade.from_parts(header["surface"], surface, source),
            Gate(**gate),
            header["gate"],
        )


class ChosenNetworks(NamedTuple):
    """Two networks, and where they apply."""

    vertex: Cascade
    surface: Cascade
    measured: Bools  # (c,) components that are treated as measured surfaces
    impulsive: Bools  # (n,) vertices of components with impulsive noise

    def vertices(self, mesh: Mesh) -> Vectors:
        """Return the denoised vertices, (n, 3), of a mesh with these components."""
        measured = self.measured[mesh.topology.face_components]
        if measured.any():
            mesh = mesh.moved(with_part_moved(mesh, measured, partial(_denoised, self.surface), self.impulsive))
        return with_part_moved(mesh, ~measured, partial(_denoised, self.vertex), self.impulsive)


def _denoised(network: Cascade, mesh: Mesh, impulsive: Bools) -> Vectors:
    """Return the vertices, (n, 3), that a network denoises, as far as there is evidence for noise.

    Outliers count as evidence. The later stages skip components without evidence.
    """
    topology = mesh.topology
    known = [stage_normals(network.stages[0], mesh, mesh)]  # released after the first stage
    evidence = np.maximum(noise_evidence(mesh, turning_angles(mesh, known[0])), impulsive)
    noisy = np.isin(topology.face_components, topology.components[evidence > 0])
    if not noisy.all():
        known = [known[0][noisy]]
    denoised = with_part_moved(mesh, noisy, lambda part: network.vertices(part, known))
    return evidence[:, None] * denoised + (1 - evidence[:, None]) * mesh.vertices


def _under(tensors: Arrays, part: str) -> Arrays:
    """Return the arrays of a part by their names within it."""
    return {name.removeprefix(f"{part}."): a for name, a in tensors.items() if name.startswith(f"{part}.")}


def read_model(path: str | PathLike[str]) -> Cascade | GatedCascades:
    """Read a weights file with one cascade, or with two and a gate.

    Raises ParameterError if the file is missing, or its model needs other filters than those of this version.
    """
    header, tensors = unpacked(path)
    if header.get("format") not in GATED_FORMATS:
        return Cascade.load(path)
    try:
        return GatedCascades.from_parts(header, tensors, fspath(path))
    except (KeyError, TypeError) as error:
        raise ParameterError(f"{fspath(path)} lacks {error}: make it again with `cascadenorm train-gate`") from None
