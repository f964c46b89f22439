"""Places of the defects of a mesh."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.api.inspection import Inspection
from cascadenorm.mesh.mesh import vertex_array
from cascadenorm.reports.given import Given

AT_FACES = {
    "bad_indices", "repeated_corners", "inside_out", "zero_area", "slivers", "duplicate_faces", "crossing_faces",
    "small_components",
}  # fmt: skip
"""Findings that are located at faces; the others are at vertices or edges."""


class DefectPlace(NamedTuple):
    # mesh, finding, label: names of the mesh and the finding, and a label such as "face 17"
    mesh: str
    finding: str
    label: str
    at: tuple[float, ...]  # position in mesh units
    radius: float  # radius of the defect in mesh units


def places(given: Given, found: Inspection) -> list[DefectPlace]:
    """Return the places listed by an inspection that have finite positions."""
    positions = vertex_array(given.file.positions)
    listed = []
    for name, finding in found.findings.items():
        for number in finding.first:
            corners = _corners(given, name, number)
            points = positions[corners[(corners >= 0) & (corners < len(positions))]]
            if len(points) and np.isfinite(points).all():
                middle = (points / len(points)).sum(axis=0)  # sums and squares of huge coordinates would overflow
                radius = float(np.hypot.reduce(points - middle, axis=1).max())
                label = _label(name, number)
                listed.append(DefectPlace(given.key, name, label, tuple(middle.tolist()), radius))
    return listed


def _corners(given: Given, name: str, number: Any) -> NDArray[np.int64]:
    """Return the vertex indices of a face, an edge or a vertex."""
    numbers = np.atleast_1d(np.asarray(number, np.int64)) - given.file.counts_from
    if name not in AT_FACES:
        return numbers
    polygons = given.file.polygons
    return polygons.corners[polygons.indptr[numbers[0]] : polygons.indptr[numbers[0] + 1]]


def _label(name: str, number: Any) -> str:
    if name in AT_FACES:
        return f"face {number}"
    return f"edge {number[0]}–{number[1]}" if isinstance(number, tuple) else f"vertex {number}"
