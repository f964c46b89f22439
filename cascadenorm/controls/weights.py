"""Compute the weight of the displacement at each vertex from the controls."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ParameterError
from cascadenorm.mesh import Bools, Floats, Ints32, Mesh, first_places, marked
from cascadenorm.registry.controls import Controls


def vertex_weights(mesh: Mesh, controls: Controls, faces: Ints32) -> Floats:
    """Return (n,) factors of the strength: the mask, with 0 for fixed, unselected and unreferenced vertices.

    A fixed boundary is not included. `faces` are those that `only` refers to, which may be more than those of the mesh.
    Raises ParameterError if mask, fixed or only has the wrong shape or type, or is out of range.
    """
    count = len(mesh.vertices)
    weights = np.zeros(count)
    weights[mesh.faces] = 1.0
    if controls["mask"] is not None:
        weights *= mask_weights(controls["mask"], count)
    if controls["fixed"] is not None:
        weights[selected_vertices("fixed", controls["fixed"], count)] = 0.0
    if controls["only"] is not None:
        weights[faces[~selected_faces(controls["only"], len(faces))]] = 0.0
    return weights


def mask_weights(given: Any, count: int) -> NDArray[Any]:
    """Return (count,) weights from 0 to 1 at vertices; refuse other masks."""
    mask = np.asarray(given)
    if mask.shape != (count,) or mask.dtype.kind not in "biuf":
        raise ParameterError(
            f"has shape {mask.shape} and type {mask.dtype}; it must be ({count},) bool or numbers from 0 to 1",
            parameter="mask",
        )
    bad = np.asarray(~((mask >= 0) & (mask <= 1)))
    if bad.any():
        raise ParameterError(
            f"has {bad.sum()} weights that are not within 0 … 1 (vertices {first_places(bad)})",
            parameter="mask",
            hint="scale them",
        )
    return mask


def selected_vertices(name: str, given: Any, count: int) -> Bools:
    """Return (count,) bool for vertices selected by indices or by (count,) bool; refuse other selections."""
    return _selected(name, np.asarray(given), count, "vertex", "vertices")


def selected_faces(only: Any, count: int) -> Bools:
    """Return (count,) bool for faces selected by indices or by (count,) bool; refuse other selections."""
    return _selected("only", np.asarray(only), count, "face", "faces")


def _selected(name: str, given: NDArray[Any], count: int, one: str, several: str) -> Bools:
    if given.dtype == bool and given.shape == (count,):
        return given
    if given.ndim != 1 or (given.dtype.kind not in "iu" and given.size > 0):
        raise ParameterError(
            f"has shape {given.shape} and type {given.dtype}; it must be ({count},) bool or indices of {several}",
            parameter=name,
        )
    bad = (given < 0) | (given >= count)
    if bad.any():
        raise ParameterError(
            f"references {one} {given[bad][0]}; there are {count} {several}, counted from 0", parameter=name
        )
    if count > 2 and given.shape == (count,) and given.max() <= 1:
        raise ParameterError(
            f"has a 0 or 1 for each of the {count} {several}, but integers are indices of {several}",
            parameter=name,
            hint="convert a mask to bool",
        )
    return marked(given.astype(np.int64), count)
