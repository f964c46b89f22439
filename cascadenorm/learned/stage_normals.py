"""Regress the normals of a stage, if necessary patch by patch."""

from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.baselines.normal_filter_bank import faces_added
from cascadenorm.geometry.patches.cutting import MeshPatch
from cascadenorm.geometry.patches.work import HALO_MARGIN, Patching, active_patching, each_patch, face_rows
from cascadenorm.learned.descriptors import CUTOFF, DESCRIPTORS, SIGMA_S
from cascadenorm.learned.features import CONTEXT_STEPS, ComponentSums
from cascadenorm.learned.packed_normals import PackedNormals
from cascadenorm.learned.regression import Regression, stage_stack
from cascadenorm.learned.stage import Stage
from cascadenorm.mesh import Mesh, Vectors

BY_DISTANCE = 14  # first halo width in edges that is tried for filters with a neighbourhood by distance
FACTS = ("mean_edge_length", "median_area")  # facts about the whole mesh that the filters need


def stage_normals(stage: Regression, mesh: Mesh, noisy: Mesh) -> Vectors:
    """Regress the true normals of a mesh after the previous stage, (m, 3); `noisy` is the mesh before all stages."""
    patching = active_patching(mesh)
    if patching is None:
        stack = stage_stack(stage.settings, mesh, noisy)
        for filtered in (mesh, noisy):  # the network needs memory, and these arrays are computed quickly
            filtered.forget_geometry()
        mesh.topology.forget_adjacent_faces()
        return stage.normals(mesh, stack)
    if not stage.scaler.projection.size:
        work = partial(_without_context, stage)
        return face_rows(
            mesh, work, receptive_field=_receptive_field(stage.settings), facts=FACTS, vertices=[noisy.vertices]
        )
    return _with_context(stage, mesh, noisy, patching)


class _Filtered(NamedTuple):
    """Filtered normals of a patch, (j, k, 3), with a halo as wide as the context features need."""

    patch: MeshPatch
    stack: PackedNormals


def _with_context(stage: Regression, mesh: Mesh, noisy: Mesh, patching: Patching) -> Vectors:
    """Regress normals with context features, some of which are means over connected components.

    The means need a separate first pass over the patches. Its filtered normals are kept for the second pass for as many
    patches as fit into memory. The other patches are filtered twice.
    """
    field = _receptive_field(stage.settings) + CONTEXT_STEPS[-1] + HALO_MARGIN
    each = partial(
        each_patch, mesh, patching, receptive_field=field, facts=FACTS, vertices=[noisy.vertices], components=True
    )
    totals = _no_sums(stage, mesh.topology.component_count)
    kept, again, spare = list[_Filtered](), list[int](), patching.spare
    for patch, (sums, filtered) in each(partial(_sums, stage, spare > 0)):
        _add(totals, sums, patch.component_numbers)
        spare -= 0 if filtered is None else filtered.stack.nbytes
        if filtered is None or spare < 0:
            again.append(patch.box)
        else:
            kept.append(filtered)
        del filtered
    out = np.empty(mesh.faces.shape)
    while kept:
        filtered = kept.pop()
        out[filtered.patch.face_numbers[filtered.patch.own]] = _regressed(stage, totals, filtered)
        del filtered
    for patch, rows in each(partial(_filtered_again, stage, totals), boxes=again):
        out[patch.face_numbers[patch.own]] = rows
    return out


def _no_sums(stage: Regression, count: int) -> ComponentSums:
    width = stage.scaler.projection.shape[1]
    return ComponentSums(np.zeros(count, np.int64), np.zeros((count, width)), np.zeros((count, 3)), np.zeros(count))


def _add(totals: ComponentSums, sums: ComponentSums, places: NDArray[Any]) -> None:
    """Add sums to the given rows of the totals. Each row occurs once."""
    pairs: Iterable[tuple[NDArray[Any], NDArray[Any]]] = zip(totals, sums, strict=True)
    for total, rows in pairs:
        total[places] += rows


def _sums(stage: Regression, keep: bool, patch: MeshPatch, noisy: Vectors) -> tuple[ComponentSums, "_Filtered | None"]:
    """Return the sums over the faces of a patch for each component, and its filtered normals if they are to be kept."""
    filtered = _filtered(stage, patch, noisy)
    own = filtered.patch.own
    part = stage.scaler.sums(filtered.stack, filtered.patch.mesh, own)
    sums = _no_sums(stage, len(patch.component_numbers))
    _add(sums, part, np.searchsorted(patch.component_numbers, filtered.patch.component_numbers))
    return sums, filtered if keep else None


def _filtered_again(stage: Regression, totals: ComponentSums, patch: MeshPatch, noisy: Vectors) -> Vectors:
    return _regressed(stage, totals, _filtered(stage, patch, noisy))


def _filtered(stage: Regression, patch: MeshPatch, noisy: Vectors) -> _Filtered:
    stack = _stack(stage.settings, patch, noisy)
    narrow, faces = patch.narrowed(CONTEXT_STEPS[-1] + HALO_MARGIN)
    return _Filtered(narrow, stack[faces])


def _regressed(stage: Regression, totals: ComponentSums, filtered: _Filtered) -> Vectors:
    """Return the normals of the faces that belong to a patch."""
    patch = filtered.patch
    every: Iterable[NDArray[Any]] = totals
    sums = ComponentSums(*(rows[patch.component_numbers] for rows in every))
    return stage.normals(patch.mesh, filtered.stack, sums)[patch.own]


def _without_context(stage: Regression, patch: MeshPatch, noisy: Vectors) -> Vectors:
    return stage.normals(patch.mesh, _stack(stage.settings, patch, noisy))


def _stack(settings: Stage, patch: MeshPatch, noisy: Vectors) -> PackedNormals:
    """Filter the normals of a patch. Raises TooNarrow if filters reach beyond the halo."""
    filters = DESCRIPTORS[settings.descriptor].filters
    if filters:
        seen = patch.own
        for _ in range(filters):
            seen = faces_added(patch.mesh, seen, sigma_s=SIGMA_S, cutoff=CUTOFF)
        patch.check_complete(seen)
    return stage_stack(settings, patch.mesh, patch.mesh.moved(noisy).with_facts(**patch.facts))


def _receptive_field(settings: Stage) -> int:
    """Return the receptive field of the filtered normals in edges, or the first one to try."""
    descriptor = DESCRIPTORS[settings.descriptor]
    return BY_DISTANCE if descriptor.filters else descriptor.rings
