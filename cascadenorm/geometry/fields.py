"""Quantities on the faces and vertices of meshes, to be seen as heat maps."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from cascadenorm.detection.noise_level import local_noise
from cascadenorm.geometry.curvature import mean_curvature
from cascadenorm.geometry.metrics import angles_at_faces, errors
from cascadenorm.mesh import Floats, Mesh, MeshError

USUAL = 0.98
"""Share of the values that the colours cover at first."""


class Quantity(NamedTuple):
    """What can be seen as a heat map.

    Parameters
    ----------
    label, unit
        As it is written; of the values.
    at
        Faces or vertices.
    signed
        Whether 0 is the middle of the colours.
    against
        The other mesh that it needs.
    """

    label: str
    unit: str
    at: Literal["face", "vertex"]
    signed: bool = False
    against: Literal["input", "truth"] | None = None


QUANTITIES: Mapping[str, Quantity] = {
    "angle": Quantity("Angle to the input", "°", "face", against="input"),
    "displacement": Quantity("Displacement", "mesh units", "vertex", against="input"),
    "normal-displacement": Quantity("Displacement along the normal", "mesh units", "vertex", True, "input"),
    "normal-error": Quantity("Angle to the truth", "°", "face", against="truth"),
    "distance": Quantity("Distance to the truth", "mesh units", "vertex", against="truth"),
    "noise": Quantity("Local noise", "mean edge lengths", "vertex"),
    "curvature": Quantity("Mean curvature", "1 / mesh unit", "vertex", signed=True),
}
"""Every quantity, by its name on the command line and in the address of a report."""


class Field(NamedTuple):
    """A quantity on some meshes.

    Parameters
    ----------
    name
        One of QUANTITIES, or that of `own`.
    values
        By the name of the mesh (m,) or (n,); NaN where there is none.
    own
        What the values are, where that is none of QUANTITIES.
    """

    name: str
    values: Mapping[str, Floats]
    own: Quantity | None = None

    @property
    def quantity(self) -> Quantity:
        """What the values are."""
        return self.own or QUANTITIES[self.name]

    @property
    def limits(self) -> tuple[float, float]:
        """Ends of the colours: all but the largest values of all meshes lie between."""
        known = np.concatenate([np.abs(values[np.isfinite(values)]) for values in self.values.values()])
        usual = float(np.quantile(known, USUAL)) if len(known) else 0.0
        usual = usual or float(known.max(initial=0.0)) or 1.0
        return (-usual if self.quantity.signed else 0.0, usual)


def fields(
    meshes: Mapping[str, Mesh], unit: float, *, known: Mapping[str, Mapping[str, Floats]] = MappingProxyType({})
) -> list[Field]:
    """Return the quantities that can be computed from the meshes of a report.

    Parameters
    ----------
    meshes
        "before", "after", "truth" or "mesh", scaled alike to about unit size.
    unit
        Length of 1 in the unit of the files.
    known
        Noise and curvature of some of them, by the names of the quantity and the mesh, which are not computed again.
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
    found["noise"] = {key: noise[key] if key in noise else local_noise(mesh) for key, mesh in judged.items()}
    found["curvature"] = {
        key: curvature[key] if key in curvature else mean_curvature(mesh) / unit for key, mesh in meshes.items()
    }
    return [Field(name, values) for name, values in found.items()]


def field(name: str, meshes: Mapping[str, Mesh], other: Mesh, unit: float) -> Field:
    """Return a quantity on meshes.

    Parameters
    ----------
    name
        One of QUANTITIES.
    meshes
        Scaled alike to about unit size.
    other
        The input or the truth, scaled as well.
    unit
        Length of 1 in the unit of the files.

    Raises
    ------
    MeshError
        The faces are not those of the input.
    """
    return Field(name, {key: _values(name, key, mesh, other, unit) for key, mesh in meshes.items()})


def _values(name: str, key: str, mesh: Mesh, other: Mesh, unit: float) -> Floats:
    against = QUANTITIES[name].against
    if against == "truth":
        return _errors(mesh, other, unit)[name]
    if against == "input":
        if not np.array_equal(mesh.faces, other.faces):
            problem = f"does not have the same faces as the mesh that it is compared with, so {name} is not defined"
            raise MeshError(f"{key} {problem}", hint="use distance")
        return _changes(other, mesh, unit)[name]
    return local_noise(mesh) if name == "noise" else mean_curvature(mesh) / unit


def _errors(mesh: Mesh, truth: Mesh, unit: float) -> dict[str, Floats]:
    """How far faces and vertices are off."""
    away = errors(mesh, truth)
    return {"normal-error": away.angles, "distance": away.distances * unit}


def _changes(before: Mesh, after: Mesh, unit: float) -> dict[str, Floats]:
    """How far the faces have turned and the vertices have moved."""
    moves = (after.vertices - before.vertices) * unit
    return {
        "angle": angles_at_faces(after.face_normals, before.face_normals),
        "displacement": np.linalg.norm(moves, axis=1),
        "normal-displacement": np.einsum("ij,ij->i", moves, before.vertex_normals),
    }
