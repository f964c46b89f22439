"""The stages of `auto` and `cascade`, each in passes over patches whose halos are as wide as one of its steps needs."""

import hashlib
import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cascadenorm.baselines.normal_filter_bank import faces_added
from cascadenorm.detection.parts import Found, added, by_component, median
from cascadenorm.detection.segmentation_steps import has_voxel_faces, mean_centroids
from cascadenorm.geometry.foldovers import foldovers, halved_where_flipped, partly_displaced
from cascadenorm.io.atomic import write_atomically
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.descriptors import CUTOFF, DESCRIPTORS, SIGMA_S
from cascadenorm.learned.drift import PASSES, without_drift
from cascadenorm.learned.features import CONTEXT_STEPS, ComponentSums
from cascadenorm.learned.methods import loaded
from cascadenorm.learned.regression import Regression, stage_stack
from cascadenorm.learned.safeguards import Bounded, what_is_bounded, within_bounds
from cascadenorm.mesh import Vectors
from cascadenorm.registry import Method
from cascadenorm.streaming.layers import Layer
from cascadenorm.streaming.passes import Passes, Steps, TooNarrow, View
from cascadenorm.streaming.sweeps import SWEEP, swept

LEARNED = ("auto", "cascade")
"""Methods that have stages."""
BY_DISTANCE = 16
"""Edges of the halo that is tried first where filters have a neighbourhood by distance."""
HALVINGS_AT_ONCE = 24
"""Of displacements that flip faces, in one pass."""
FILTERS, NETWORK, ONCE = 10.0, 8.0, 3.0
"""Cost of the passes of a stage, for the progress."""

Facts = dict[str, float]


def learned_steps(method: Method, parameters: Mapping[str, Any]) -> Steps:
    """Return the passes of a learned method.

    Raises
    ------
    ParameterError : weights that cannot be read
    """
    given = method.with_defaults(parameters)
    cascade = loaded(given["model"], method.name)
    return Steps(
        lambda passes: restored(passes, method.name, cascade),
        sum(FILTERS + NETWORK + stage.settings.sweeps * SWEEP for stage in cascade.stages) + 3 * ONCE,
        hashlib.sha256(cascade.to_bytes()).hexdigest(),
    )


def restored(passes: Passes, name: str, cascade: Cascade) -> Callable[[View], Vectors]:
    """Do the passes of a method; return what gives its result on a patch with a halo of any width, in the frame."""
    start = None
    safe = name == "auto"
    if safe and has_voxel_faces(passes):
        start = passes.positions("start")
        passes.run("start", 2, lambda view: view.keep_vertices(start, mean_centroids(view.mesh)))
    last = start
    for number, stage in enumerate(cascade.stages, 1):
        before, last = last, _after_stage(passes, f"stage {number}", stage, last, start)
        if before is not None and before is not start and before is not last:
            before.remove()
    return _safeguarded(passes, last) if safe else lambda view: view.vertices(last)


def _after_stage(
    passes: Passes, name: str, stage: Regression, before: Layer | None, start: Layer | None
) -> Layer | None:
    """Do what `learned.cascade.apply_stage` does; return where the positions are.

    Parameters
    ----------
    before, start : positions before this stage, and before the first one; None: as they were given
    """
    facts = _facts(passes, f"{name} facts", before)
    stack, sums = _stacks(passes, name, stage, before, start, facts)
    normals = passes.normals(name)

    def regress(view: View) -> None:
        of_here = None if sums is None else ComponentSums(*(rows[view.components] for rows in sums))
        mesh = view.mesh_at(before, **facts)
        view.keep_faces(normals, stage.normals(mesh, view.of_faces(stack), of_here))

    passes.run(f"{name} normals", CONTEXT_STEPS[-1] + 2, regress, NETWORK)
    stack.remove()
    settings = stage.settings
    after = swept(
        passes, name, before, normals, facts=facts,
        sweeps=settings.sweeps, weighting=settings.weighting, foldovers=settings.foldovers,
    )  # fmt: skip
    normals.remove()
    return after


def _stacks(
    passes: Passes, name: str, stage: Regression, before: Layer | None, start: Layer | None, facts: Facts
) -> tuple[Layer, ComponentSums | None]:
    """Write the filtered normals of all faces; return them, and what their context takes of connected components."""
    settings = stage.settings
    descriptor = DESCRIPTORS[settings.descriptor]
    kind = np.dtype(("f4", (descriptor.size, 3)))
    stack = passes.store.face_layer(f"{name}_stack".replace(" ", "_"), kind)
    by_distance = descriptor.filters > 0 and settings.neighborhood == "distance"

    def describe(view: View) -> Found:
        mesh, noisy = view.mesh_at(before, **facts), view.mesh_at(start)
        if by_distance:
            own = np.asarray((~view.patch.halo.vertices)[mesh.faces].any(axis=1))
            for _ in range(descriptor.filters):
                own = faces_added(mesh, own, sigma_s=SIGMA_S, cutoff=CUTOFF)
            if not view.complete[mesh.faces[own]].all():
                raise TooNarrow
        found = stage_stack(settings, mesh, noisy)
        view.keep_faces(stack, found)
        if not stage.scaler.projection.size:
            return {}
        return stage.scaler.sums(found, mesh, view.part.faces)._asdict()

    rings = BY_DISTANCE if by_distance else descriptor.rings + 2
    found = passes.run(f"{name} stack", rings, describe, FILTERS)
    if not stage.scaler.projection.size:
        return stack, None
    return stack, ComponentSums(**by_component(found, passes.components))


def _facts(passes: Passes, name: str, positions: Layer | None) -> Facts:
    """Return what filters need to know of all edges and faces where the vertices are at some positions."""
    path = passes.folder / f"{name.replace(' ', '_')}.json"
    areas = passes.store.face_layer(f"{name} areas".replace(" ", "_"), np.float64)
    if not path.exists():

        def measure(view: View) -> Found:
            mesh, part = view.mesh_at(positions), view.part
            view.keep_faces_once(areas, mesh.areas)
            lengths = view.edge_lengths(mesh)
            return {
                "length": lengths.sum(),
                "edges": np.array(len(lengths)),
                "faces": np.count_nonzero(mesh.areas[part.faces]),
            }

        sums = added(passes.run(name, 2, measure))
        count = int(sums["faces"])
        mean = float(sums["length"]) / int(sums["edges"])
        facts = {
            "mean_edge_length": passes.store.whole.mean_edge_length if positions is None else mean,
            "median_area": median(areas.blocks, count, areas.rows - count) if count else 1.0,
        }
        write_atomically(path, [json.dumps(facts).encode()])
    areas.remove()
    return dict(json.loads(path.read_text(encoding="ascii")))


def _safeguarded(passes: Passes, last: Layer | None) -> Callable[[View], Vectors]:
    """Take out the drift of the vertices, and take back what `learned.safeguards.safeguarded` does."""
    exact, untold, voxel_faces = what_is_bounded(passes)
    wanted = passes.positions("wanted")

    def bound(view: View) -> None:
        here = Bounded(exact[view.components], untold[view.components], voxel_faces)
        moved = without_drift(view.mesh, view.vertices(last))
        view.keep_vertices(wanted, within_bounds(view.mesh, moved, here))

    passes.run("wanted", PASSES + 3, bound, 2 * ONCE)
    halvings = _halvings(passes, wanted)
    return lambda view: partly_displaced(view.mesh, view.of_vertices(wanted), view.of_vertices(halvings))


def _halvings(passes: Passes, wanted: Layer) -> Layer:
    """Write how often the displacement of each vertex is halved so that no face flips; return where.

    A halving is seen one edge farther away by the next one. So as many are made in a pass as its halo allows, and there
    are passes as long as a face flips.
    """
    number, after = 0, None
    while True:
        before, after = after, passes.store.vertex_layer(f"halvings_{number}", np.uint8)

        def halve(view: View, before: Layer | None = before, after: Layer = after) -> Found:
            mesh, vertices = view.mesh, view.of_vertices(wanted)
            held = ~foldovers(mesh) & (mesh.areas > 0)
            halvings = np.zeros(len(vertices), np.uint8) if before is None else view.of_vertices(before)
            for _ in range(HALVINGS_AT_ONCE):
                if not halved_where_flipped(mesh, vertices, held, halvings).any():
                    break
            view.keep_vertices(after, halvings)
            left = halved_where_flipped(mesh, vertices, held, halvings)
            return {"flipped": (left & view.part.faces).sum()}

        found = passes.run(f"halvings {number}", HALVINGS_AT_ONCE + 6, halve, ONCE if number == 0 else 0.0)
        if not added(found)["flipped"]:
            return after
        number += 1
