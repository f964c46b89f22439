"""`guided-normal` in passes over patches; its distances are averages over the whole, and a pass measures them."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from cascadenorm.baselines.guided_normal import (
    GuidedFilter,
    centroid_distances,
    faces_within,
    guided_filter,
    guided_normals,
)
from cascadenorm.detection.parts import Found, added
from cascadenorm.errors import ParameterError
from cascadenorm.mesh import Bools, Csr, Vectors
from cascadenorm.registry import Method
from cascadenorm.streaming.layers import Layer
from cascadenorm.streaming.passes import Passes, Steps, TooNarrow, View
from cascadenorm.streaming.sweeps import SWEEP, swept

RINGS = 12
"""Edges of the halo that is tried first; the neighbourhoods are by distance."""
FILTER = 2.0
"""Cost of a pass of the filter, for the progress."""


def guided_steps(method: Method, parameters: Mapping[str, Any]) -> Steps:
    """Return the passes of `guided-normal`.

    Raises
    ------
    ParameterError : vertices by least squares, which solves a system of all of them
    """
    given = method.with_defaults(parameters)
    if given["fit"] != "sweeps":
        raise ParameterError(
            f"is {given['fit']!r}, which solves a system of all vertices; it must be 'sweeps' in patches",
            parameter="fit",
        )
    iterations = guided_filter(given["guidance"], given["sigma_r"], given["iterations"]).iterations
    return Steps(lambda passes: _denoised(passes, given), iterations * (FILTER + given["sweeps"] * SWEEP))


def _denoised(passes: Passes, given: Mapping[str, Any]) -> Callable[[View], Vectors]:
    """Do the passes with all parameters; return what gives the result on a patch with a halo of any width."""
    chosen = guided_filter(given["guidance"], given["sigma_r"], given["iterations"])
    radius, last = given["radius"], None
    for number in range(1, chosen.iterations + 1):
        name, before = f"pass {number}", last
        edge, distance = _lengths(passes, f"{name} lengths", before)
        radius = 2 * distance if radius is None else radius
        spread, facts = distance if given["sigma_s"] is None else given["sigma_s"], {"mean_edge_length": edge}
        normals = passes.normals(name)
        average = partial(_average, before, normals, chosen, radius=radius, sigma_s=spread, facts=facts)
        passes.run(f"{name} normals", RINGS, average, FILTER)
        last = swept(passes, name, before, normals, sweeps=given["sweeps"], facts=facts)
        normals.remove()
        if before is not None and before is not last:
            before.remove()
    return lambda view: view.vertices(last)


def _average(
    before: Layer | None,
    normals: Layer,
    chosen: GuidedFilter,
    view: View,
    *,
    radius: float,
    sigma_s: float,
    facts: dict[str, float],
) -> None:
    """Write the normals of a patch after a pass of the filter; neighbours are those of the mesh as it was given."""
    neighbors = faces_within(view.mesh, radius)
    _check_width(view, neighbors, chosen)
    view.keep_faces(normals, guided_normals(view.mesh_at(before, **facts), neighbors, chosen, sigma_s=sigma_s))


def _lengths(passes: Passes, name: str, positions: Layer | None) -> tuple[float, float]:
    """Return the mean edge length, and the mean distance of centroids of faces at an edge relative to it."""

    def measure(view: View) -> Found:
        mesh = view.mesh_at(positions)
        lengths, distances = view.edge_lengths(mesh), centroid_distances(mesh)[view.part.interior_edges]
        return {
            "lengths": lengths.sum(),
            "edges": np.array(len(lengths)),
            "distances": distances.sum(),
            "pairs": np.array(len(distances)),
        }

    sums = added(passes.run(name, 2, measure))
    mean = float(sums["lengths"]) / int(sums["edges"])
    edge = passes.store.whole.mean_edge_length if positions is None else mean
    total = float(sums["distances"])
    return edge, total / int(sums["pairs"]) / edge if total > 0 else 1.0


def _check_width(view: View, neighbors: Csr, chosen: GuidedFilter) -> None:
    """Raise TooNarrow unless the patch holds all faces on which the new normals of its own faces depend."""
    mesh = view.mesh
    own = np.asarray((~view.patch.halo.vertices)[mesh.faces].any(axis=1))
    around = neighbors if chosen.guidance == "gaussian" else mesh.topology.face_rings(1)
    seen = _with(_with(own, neighbors), around)  # their neighbours, and those whose guidance these have
    if not view.complete[mesh.faces[seen]].all():
        raise TooNarrow


def _with(faces: Bools, neighbors: Csr) -> Bools:
    """Return some faces, (m,) bool, with their neighbours."""
    out = faces.copy()
    out[neighbors.indices[faces[neighbors.rows]]] = True
    return out
