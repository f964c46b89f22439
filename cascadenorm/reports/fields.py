"""Quantities on the faces and vertices of meshes, to be seen as heat maps."""

from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.evaluation.metrics import angles_at_faces, errors
from cascadenorm.geometry.curvature import mean_curvature
from cascadenorm.geometry.noise_level import local_noise
from cascadenorm.mesh import Mesh

USUAL = 0.98
"""Share of the values that the colours cover at first."""

Values = NDArray[np.float64]


class Field(NamedTuple):
    """A quantity on some of the meshes of a report.

    Parameters
    ----------
    name, label, unit : in the hash of the address; as it is written; of the values
    at : faces or vertices
    signed : whether 0 is the middle of the colours
    values : by the name of the mesh (m,) or (n,); NaN where there is none
    """

    name: str
    label: str
    unit: str
    at: Literal["face", "vertex"]
    signed: bool
    values: Mapping[str, Values]

    @property
    def limits(self) -> tuple[float, float]:
        """Ends of the colours: all but the largest values of all meshes lie between."""
        known = np.concatenate([np.abs(values[np.isfinite(values)]) for values in self.values.values()])
        usual = float(np.quantile(known, USUAL)) if len(known) else 0.0
        usual = usual or float(known.max(initial=0.0)) or 1.0
        return (-usual if self.signed else 0.0, usual)


def fields(meshes: Mapping[str, Mesh], unit: float) -> list[Field]:
    """Return the quantities that can be computed from the meshes of a report.

    Parameters
    ----------
    meshes : "before", "after", "truth" or "mesh", scaled alike to about unit size
    unit : length of 1 in the unit of the files
    """
    judged = {key: mesh for key, mesh in meshes.items() if key != "truth"}
    found = []
    if "after" in meshes and np.array_equal(meshes["before"].faces, meshes["after"].faces):
        found += _changes(meshes["before"], meshes["after"], unit)
    if "truth" in meshes:
        away = {key: errors(mesh, meshes["truth"]) for key, mesh in judged.items()}
        angles = {key: found.angles for key, found in away.items()}
        distances = {key: found.distances * unit for key, found in away.items()}
        found.append(Field("angle-truth", "Angle to the truth", "°", "face", False, angles))
        found.append(Field("distance-truth", "Distance to the truth", "mesh units", "vertex", False, distances))
    found.append(_each("noise", "Local noise", "mean edge lengths", False, judged, local_noise))
    found.append(
        _each("curvature", "Mean curvature", "1 / mesh unit", True, meshes, lambda m: mean_curvature(m) / unit)
    )
    return found


def _changes(before: Mesh, after: Mesh, unit: float) -> list[Field]:
    """How far the faces have turned and the vertices have moved."""
    turned = angles_at_faces(after.normals, before.normals)
    moves = (after.vertices - before.vertices) * unit
    length = np.linalg.norm(moves, axis=1)
    along = np.einsum("ij,ij->i", moves, before.vertex_normals)
    return [
        Field("angle", "Angle to the input", "°", "face", False, _both(turned)),
        Field("displacement", "Displacement", "mesh units", "vertex", False, _both(length)),
        Field("normal-displacement", "Displacement along the normal", "mesh units", "vertex", True, _both(along)),
    ]


def _both(values: Values) -> dict[str, Values]:
    return {"before": values, "after": values}


def _each(
    name: str, label: str, unit: str, signed: bool, meshes: Mapping[str, Mesh], values: Callable[[Mesh], Values]
) -> Field:
    return Field(name, label, unit, "vertex", signed, {key: values(mesh) for key, mesh in meshes.items()})
