"""Paint on a mesh: weights of the displacement, and pinned vertices; one byte per vertex."""

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.errors import ParameterError
from cascadenorm.mesh import Mesh
from cascadenorm.registry.controls import Controls
from cascadenorm.reports.decimation import Display

FREE, PINNED = 0, 255
"""Codes of unpainted vertices, which move, and of pinned ones. Codes 1 … 101 are weights of 0 … 100 %."""


def over_painted(codes: bytes, mesh: Mesh, shown: Display) -> NDArray[np.uint8]:
    """Return (n,) codes from those of the displayed vertices. Raises ParameterError for invalid ones."""
    given = np.frombuffer(codes, np.uint8)
    if len(given) != len(shown.kept_vertices):
        raise ParameterError(
            f"the paint has {len(given)} codes for {len(shown.kept_vertices)} shown vertices: open the mesh again"
        )
    if ((given > 101) & (given != PINNED)).any():
        raise ParameterError("the paint has a code other than 0 to 101 and 255: open the mesh again")
    if len(given) == len(mesh.vertices):
        return given.copy()
    nearest = scipy.spatial.cKDTree(mesh.vertices[shown.kept_vertices]).query(mesh.vertices)[1]
    return np.asarray(given[nearest], np.uint8)


def weights(paint: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return (n,) weights of the displacement, from 0 to 1."""
    return np.where((paint == FREE) | (paint == PINNED), 1.0, (paint.astype(float) - 1) / 100)


def has_paint(paint: NDArray[np.uint8]) -> dict[str, bool]:
    """Return whether any vertex has paint of the kinds `mask` and `fixed`."""
    return {"mask": bool(((paint != FREE) & (paint != PINNED)).any()), "fixed": bool((paint == PINNED).any())}


def with_paint(controls: Controls, paint: NDArray[np.uint8]) -> Controls:
    """Return controls in which mask and fixed are arrays that include the paint, or None. Weights multiply."""
    found = controls.copy()
    pinned = paint == PINNED
    if has_paint(paint)["mask"]:
        given = 1.0 if controls["mask"] is None else np.asarray(controls["mask"], np.float64)
        found["mask"] = given * weights(paint)
    if controls["fixed"] is not None:
        given_fixed = np.asarray(controls["fixed"])
        pinned = pinned | (given_fixed if given_fixed.dtype == bool else np.isin(np.arange(len(paint)), given_fixed))
    found["fixed"] = pinned if pinned.any() else None
    return found
