"""Quantities on faces and vertices for display as heat maps."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from cascadenorm.detection.noise_level import local_noise
from cascadenorm.geometry.curvature import mean_curvature
from cascadenorm.geometry.metrics import angles_at_faces, errors
from cascadenorm.geometry.orientation import oriented
from cascadenorm.mesh import Floats, Mesh, MeshError, surface_of

USUAL = 0.98  # quantile of the absolute values at the end of the default colour range


class Quantity(NamedTuple):
    """A quantity that can be displayed as a heat map."""

    label: str  # name for display
    unit: str
    at: Literal["face", "vertex"]
    signed: bool = False  # whether the colour range is centred at 0
    against: Literal["input", "truth"] | None = None  # other mesh that it needs


QUANTITIES: Mapping[str, Quantity] = {
    "angle": Quantity("Angle to the input", "°", "face", against="input"),
    "displacement": Quantity("Displacement", "mesh units", "vertex", against="input"),
    "normal-displacement": Quantity("Displacement along the normal", "mesh units", "vertex", True, "input"),
    "normal-error": Quantity("Angle to the truth", "°", "face", against="truth"),
    "distance": Quantity("Distance to the truth", "mesh units", "vertex", against="truth"),
    "noise": Quantity("Local noise", "mean edge lengths", "vertex"),
    "curvature": Quantity("Mean curvature", "1 / mesh unit", "vertex", signed=True),
}
"""All quantities by their name on the command line and in the URL of a report."""


class Field(NamedTuple):
    """The values of a quantity on one or more meshes."""

    name: str  # key in QUANTITIES, or the name of `own`
    values: Mapping[str, Floats]  # (m,) or (n,) values by the name of the mesh; NaN where undefined
    own: Quantity | None = None  # a quantity that is not in QUANTITIES

    @property
    def quantity(self) -> Quantity:
        """Description of the quantity."""
        return self.own or QUANTITIES[self.name]

    @property
    def limits(self) -> tuple[float, float]:
        """Limits of the colour range, which covers all but the largest values of all meshes."""
        known = np.concatenate([np.abs(values[np.isfinite(values)]) for values in self.values.values()])
        usual = float(np.quantile(known, USUAL)) if len(known) else 0.0
        usual = usual or float(known.max(initial=0.0)) or 1.0
        return (-usual if self.quantity.signed else 0.0, usual)


def fields(
    meshes: Mapping[str, Mesh], unit: float, *, known: Mapping[str, Mapping[str, Floats]] = MappingProxyType({})
) -> list[Field]:
    """Return the quantities that can be computed from the meshes of a report: "before", "after", "truth" or "mesh".

    They have a common scale of about unit size, whose unit length is `unit` in that of the files. Noise and curvature
    may be known already, by the names of the quantity and the mesh.
    """
    noise, curvature = known.get("noise", {}), known.get("curvature", {})
    judged = {key: mesh for key, mesh in meshes.items() if key != "truth"}
    found: dict[str, dict[str, Floats]] = {}
    if {"before", "after"} <= set(meshes) and np.array_equal(meshes["before"].faces, meshes["after"].faces):
        changes = _changes(meshes["before"], meshes["after"], unit)
        found |= {name: {"before": values, "after": values} for name, values in changes.items()}
    if "truth" in meshes:
        away = {key: _errors(mesh, meshes["truth"], unit) for key, mesh in judged.items()}
        found |= {name: {key: one[name] for key, one in away.items()} for name in ("normal-error", "distance")}
    found["noise"] = {key: noise[key] if key in noise else _noise(mesh) for key, mesh in judged.items()}
    found["curvature"] = {
        key: curvature[key] if key in curvature else _curvature(mesh, unit) for key, mesh in meshes.items()
    }
    return [Field(name, values) for name, values in found.items()]


def field(name: str, meshes: Mapping[str, Mesh], other: Mesh, unit: float) -> Field:
    """Compute a quantity, a key in QUANTITIES, on one or more meshes by name; `other` is the input or the ground truth.

    All have a common scale of about unit size, whose unit length is `unit` in that of the files. Raises MeshError if
    the quantity compares with the input, and the faces differ from those of the input.
    """
    return Field(name, {key: _values(name, key, mesh, other, unit) for key, mesh in meshes.items()})


def _values(name: str, key: str, mesh: Mesh, other: Mesh, unit: float) -> Floats:
    against = QUANTITIES[name].against
    if against is None:
        return _noise(mesh) if name == "noise" else _curvature(mesh, unit)
    if against == "input" and not np.array_equal(mesh.faces, other.faces):
        problem = f"does not have the same faces as the mesh that it is compared with, so {name} is not defined"
        raise MeshError(f"{key} {problem}", hint="use distance")
    return (_errors(mesh, other, unit) if against == "truth" else _changes(other, mesh, unit))[name]


def _noise(mesh: Mesh) -> Floats:
    """Return the local noise, which does not depend on the orientation of the faces."""
    return local_noise(oriented(surface_of(mesh)))


def _curvature(mesh: Mesh, unit: float) -> Floats:
    """Return the mean curvature in the unit of the files."""
    return mean_curvature(surface_of(mesh)) / unit


def _errors(mesh: Mesh, truth: Mesh, unit: float) -> dict[str, Floats]:
    """Return the errors of face normals and vertices against the ground truth."""
    away = errors(mesh, truth)
    return {"normal-error": away.angles, "distance": away.distances * unit}


def _changes(before: Mesh, after: Mesh, unit: float) -> dict[str, Floats]:
    """Return the rotation of the face normals and the displacement of the vertices."""
    moves = (after.vertices - before.vertices) * unit
    return {
        "angle": angles_at_faces(after.face_normals, before.face_normals),
        "displacement": np.linalg.norm(moves, axis=1),
        "normal-displacement": np.einsum("ij,ij->i", moves, surface_of(before).vertex_normals),
    }
