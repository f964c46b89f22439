"""Two cascades and the gate that chooses between them for each component of a mesh."""

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Any, NamedTuple

import numpy as np

from cascadenorm.detection.gate import Gate, Judged, Treatment, judged
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.weights import Arrays, packed, unpacked
from cascadenorm.mesh import Bools, Mesh, Vectors, part_of
from cascadenorm.registry import ParameterError

GATED_FORMATS = ("cascadenorm-gated/2", "cascadenorm-gated/1")
"""Formats of weights files, the first of which is written; cascades within them are as in CASCADE_FORMATS."""


@dataclass(frozen=True)
class GatedCascades:
    """The model behind `auto`.

    Parameters
    ----------
    vertex
        Network for noise on the vertices of a shape.
    surface
        Network for measured surfaces: what volumes, scanners, cameras and point clouds leave.
    gate
        Chooses between them from how the triangles lie.
    gate_card
        How the gate was made; anything that JSON can hold.
    """

    vertex: Cascade
    surface: Cascade
    gate: Gate
    gate_card: Mapping[str, Any]

    @property
    def card(self) -> dict[str, Any]:
        """How the parts were made and what they reach, by their names."""
        return {"vertex": self.vertex.card, "surface": self.surface.card, "gate": self.gate_card}

    @property
    def networks(self) -> dict[str, Cascade]:
        """Both networks by their names."""
        return {"vertex": self.vertex, "surface": self.surface}

    def judged(self, mesh: Mesh, treat_as: Treatment | None = None) -> Judged:
        """Judge each component of a mesh, or treat all of them alike."""
        if treat_as is None:
            return judged(self.gate, mesh)
        probability = float(treat_as == "measured-surface")
        count = int(mesh.topology.components.max()) + 1
        return Judged(np.full(count, probability == 1), np.full(count, probability))

    def chosen(self, measured: Bools) -> "ChosenNetworks":
        """Return the networks with the choice for each component, (c,)."""
        return ChosenNetworks(self.vertex, self.surface, measured)

    def vertices(self, mesh: Mesh) -> Vectors:
        """Return the denoised vertices, (n, 3), of each component from the network that the gate chooses."""
        return self.chosen(self.judged(mesh).measured).vertices(mesh)

    def to_bytes(self) -> bytes:
        """Return the content of a weights file: the same bytes for the same model."""
        parts = {"vertex": self.vertex.tensors(), "surface": self.surface.tensors(), "gate": self.gate.arrays()}
        tensors: Arrays = {f"{part}.{name}": a for part, arrays in parts.items() for name, a in arrays.items()}
        headers = {"vertex": self.vertex.header(), "surface": self.surface.header(), "gate": self.gate_card}
        return packed({"format": GATED_FORMATS[0], **headers}, tensors)

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], tensors: Arrays, source: str) -> "GatedCascades":
        """Rebuild a model from its header and its arrays; errors are those of `Cascade.from_parts`."""
        vertex, surface, gate = (_under(tensors, part) for part in ("vertex", "surface", "gate"))
        return cls(
            Cascade.from_parts(header["vertex"], vertex, source),
            Cascade.from_parts(header["surface"], surface, source),
            Gate(**gate),
            header["gate"],
        )


class ChosenNetworks(NamedTuple):
    """Two networks, and which components are treated as measured surfaces, (c,)."""

    vertex: Cascade
    surface: Cascade
    measured: Bools

    def vertices(self, mesh: Mesh) -> Vectors:
        """Return the denoised vertices, (n, 3), of a mesh with these components."""
        measured = self.measured[mesh.topology.face_components]
        if measured.all() or not measured.any():
            return (self.surface if measured.all() else self.vertex).vertices(mesh)
        vertices = mesh.vertices.copy()
        for cascade, faces in ((self.vertex, ~measured), (self.surface, measured)):
            part, numbers = part_of(mesh, faces)
            vertices[numbers] = cascade.vertices(part)
        return vertices


def _under(tensors: Arrays, part: str) -> Arrays:
    """Return the arrays of a part by their names within it."""
    return {name.removeprefix(f"{part}."): a for name, a in tensors.items() if name.startswith(f"{part}.")}


def read_model(path: str | PathLike[str]) -> Cascade | GatedCascades:
    """Read a weights file: one cascade, or two with a gate.

    Raises
    ------
    ParameterError
        The file is missing, or holds no model for the filters of this version.
    """
    header, tensors = unpacked(path)
    if header.get("format") not in GATED_FORMATS:
        return Cascade.load(path)
    try:
        return GatedCascades.from_parts(header, tensors, fspath(path))
    except (KeyError, TypeError) as error:
        raise ParameterError(f"{fspath(path)} lacks {error}: make it again with `cascadenorm train-gate`") from None
