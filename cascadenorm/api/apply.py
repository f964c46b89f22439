"""A method under the controls: in its frame, where and as strongly as wanted, within limits."""

import math
from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.api.halo import Halo, as_part, check_halo
from cascadenorm.controls.boundary import boundary_edges, smoothed_boundary
from cascadenorm.controls.creases import crease_edges, cut_along
from cascadenorm.controls.detail import TREAT_AS, Removal, Removed, applied, finer_than, without_finer
from cascadenorm.controls.displacement import displaced, framed_length
from cascadenorm.controls.settings import CONTROLS, Controls
from cascadenorm.controls.sliding import Sliding, sliding
from cascadenorm.controls.weights import holds_some, vertex_weights
from cascadenorm.errors import DenoiseError, ParameterError
from cascadenorm.execution.progress import report_to, track
from cascadenorm.geometry.orientation import oriented
from cascadenorm.geometry.volume import with_volume_of
from cascadenorm.mesh import (
    Ints,
    Mesh,
    Renumbered,
    Vectors,
    all_in_rows,
    first_places,
    in_frame,
    one_blas_thread,
    ordered_for_cache,
    without_lines,
    without_repeated_faces,
)
from cascadenorm.patches.work import free_derived
from cascadenorm.regions.region_volumes import with_region_volumes
from cascadenorm.regions.shells import Shells, into_shells
from cascadenorm.regions.walls import joined_walls
from cascadenorm.registry import REGION, Method

Step = Callable[[Mesh], Vectors]
"""One application of a method with what surrounds it, from a mesh to its new vertices."""


def controlled(
    method: Method,
    mesh: Mesh,
    parameters: Mapping[str, Any],
    controls: Controls,
    *,
    dtype: Any = np.float64,
    steps: list[Vectors] | None = None,
) -> NDArray[Any]:
    """Apply a method to a mesh under controls.

    The method sees the mesh centered at the origin, scaled by a power of two to about unit size, consistently oriented,
    without degenerate and repeated faces, and in an order that is kind to memory. Its displacement is added to the
    vertices in their own coordinates, so coordinates far from the origin lose nothing, and a vertex that does not move
    or that no face uses keeps its bits.

    Parameters
    ----------
    controls
        All of them, as `checked` returns them.
    dtype
        Floating type of the result.
    steps
        What the applications of the method gave in an earlier call, which are not made again; others are added. The
        calls have the same arguments but for a strength of the same `step_key`.

    Returns
    -------
    (n, 3), a copy

    Raises
    ------
    ParameterError
        A parameter, mask or limit that is out of range or does not fit the mesh.
    DenoiseError
        The method returned vertices that are not finite.
    """
    checked = _checked_parameters(method, parameters)
    controls = {**controls, "strength": min(controls["strength"], MOST_STRENGTH)}
    faces, mesh = mesh.faces, without_repeated_faces(without_lines(mesh))
    weights = vertex_weights(mesh, controls, faces)
    halo = None if controls["halo"] is None else check_halo(method, parameters, mesh, controls)
    order, framed, parts, exponent = _prepared(mesh, halo)
    free_derived(mesh, order.mesh, framed)
    weights = weights[order.numbers]
    if REGION in method.settings and holds_some(controls):
        checked[REGION] = weights > 0
    if halo is not None:
        weights = np.where(halo.vertices, 0.0, weights)
    detail = framed_length("keep_detail", controls["keep_detail"], framed, exponent)
    limit = framed_length("max_displacement", controls["max_displacement"], framed, exponent)
    with one_blas_thread(), report_to(controls["progress"]):
        strength = min(controls["strength"], 1.0) if method.converges else controls["strength"]
        removed = _detail_to_remove(method, controls, framed, exponent)
        step = _step(method, framed, order, parts, checked, controls, detail, removed)
        slides = None if controls["slide"] is None else sliding(framed)
        if slides is not None:
            step = _sliding_step(step, slides)
        displacement = _accumulated(step, framed, strength * weights, steps)
        if controls["volume"] == "keep":
            displacement = _volume_preserving(framed, parts, displacement, weights)
            displacement = displacement if slides is None else slides.constrained(displacement)
    del step
    free_derived(mesh, order.mesh, framed)
    if controls["progress"] is not None:
        controls["progress"](1.0)
    return displaced(mesh, displacement[order.places], exponent=exponent, limit=limit, dtype=np.dtype(dtype))


def step_key(method: Method, strength: float) -> float:
    """Return what of a strength decides on the result of each application of a method; the rest only blends them."""
    return min(max(strength, 1.0), MOST_STRENGTH) if method.converges else 1.0


def _prepared(mesh: Mesh, halo: Halo | None) -> tuple[Renumbered, Mesh, Shells | None, int]:
    """Return how vertices are numbered, the mesh as the method sees it, its shells, and the exponent of the frame."""
    if halo is None:
        framed, exponent = in_frame(mesh)
        order = ordered_for_cache(framed)
        return order, *into_shells(oriented(order.mesh)), exponent
    return Renumbered.unchanged(mesh), as_part(mesh, halo.whole), None, halo.whole.frame.exponent


def reported_controls(controls: Controls) -> dict[str, Any]:
    """Return the controls that a report names, as they were given; arrays by their shape alone."""
    return {name: _in_words(controls[name]) for name in CONTROLS if name not in UNREPORTED}  # type: ignore[literal-required]


EDGES = 2.0
"""Width of the detail, in mean edge lengths, that each 1 of strength above 1 adds after a method that converges."""

MOST_STRENGTH = 10.0
"""A larger strength acts as this one: each 1 of it is a further pass, and shape has gone long before."""

UNREPORTED = ("strength", "threads", "progress", "halo")
"""Controls that a report does not name: strength has a field of its own, halos are for arrays, the others do not change
the result."""


def _in_words(value: Any) -> Any:
    array = np.asarray(value)
    return value if array.ndim == 0 or array.dtype.kind == "U" else f"array of shape {array.shape}"


def _checked_parameters(method: Method, parameters: Mapping[str, Any]) -> dict[str, Any]:
    if REGION in parameters:
        raise ParameterError("is derived from the controls: pass mask, fixed or only", parameter=REGION)
    return method.checked(parameters)


def _detail_to_remove(method: Method, controls: Controls, framed: Mesh, exponent: int) -> Removed:
    """Return the width of `remove_detail`, and what a strength above 1 removes after a method that converges.

    Each 1 of strength above 1 is one more removal on the result so far, of detail EDGES wider; the last
    one may be partial. So a strength builds on what less of it removes.
    """
    given, removals = controls["remove_detail"], []
    if method.converges:
        more = controls["strength"] - 1
        for number in range(math.ceil(more)):
            width = (number + 1) * EDGES * framed.mean_edge_length
            removals.append(Removal(width, min(more - number, 1.0)))
    return Removed(None if given is None else framed_length("remove_detail", given, framed, exponent), removals)


def _step(
    method: Method,
    mesh: Mesh,
    order: Renumbered,
    parts: Shells | None,
    parameters: Mapping[str, Any],
    controls: Controls,
    detail: float,
    removed: Removed,
) -> Step:
    """Return the method together with creases, boundary and detail, which apply each time that it does.

    Where regions share walls, all that sees the shell of each region, and the walls are joined from their two sides.

    Parameters
    ----------
    mesh
        In the frame; every mesh that the step is given has its faces.
    order
        How its vertices are numbered.
    parts
        The shells of its regions, where these share walls.
    detail
        Width of the smallest feature to keep, in the unit of the frame.
    removed
        Detail to remove.
    """
    creases = cast("float | ArrayLike | None", controls["creases"])  # files have been read
    edges = None if creases is None else crease_edges(mesh, creases, order.places)
    if parts is None:
        return _surface_step(method, mesh, order.numbers, parameters, controls, edges, detail, removed)
    if REGION in parameters:
        parameters = {**parameters, REGION: parameters[REGION][parts.owners]}
    edges = None if edges is None else parts.of_edges(mesh, edges)
    each = _surface_step(method, parts.mesh, order.numbers[parts.owners], parameters, controls, edges, detail, removed)
    return lambda walls: joined_walls(parts, walls, each(parts.of(walls)))


def _sliding_step(step: Step, slides: Sliding) -> Step:
    """Return a step after which vertices on flat sides are still there."""
    return lambda mesh: slides.slid(mesh, step(mesh))


def _surface_step(
    method: Method,
    mesh: Mesh,
    numbers: Ints,
    parameters: Mapping[str, Any],
    controls: Controls,
    creases: NDArray[np.bool_] | None,
    detail: float,
    removed: Removed,
) -> Step:
    """Return the step of a mesh without shared walls.

    Parameters
    ----------
    numbers
        (n,) its vertices as they were given, for messages.
    creases
        (e,) whether each of its edges is one.
    """
    # Along creases the method, and all that follows, sees copies of the vertices
    sides = None if creases is None else cut_along(mesh, creases)
    seen = mesh if sides is None else sides.mesh
    numbers = numbers if sides is None else numbers[sides.owners]
    if sides is not None and REGION in parameters:
        parameters = {**parameters, REGION: parameters[REGION][sides.owners]}
    # A cut mesh has boundaries everywhere, which only one of the two networks of `auto` has learned
    if sides is not None and TREAT_AS in method.settings and parameters.get(TREAT_AS) is None:
        parameters = {**parameters, TREAT_AS: "measured-surface"}

    # The boundary is that of the uncut mesh, in the vertices of the cut one; detail is smoothed on each side
    edges = boundary_edges(mesh, seen.faces) if controls["boundary"] == "smooth" else None
    finer = None if controls["keep_detail"] is None else finer_than(detail, seen)

    def step(mesh: Mesh) -> Vectors:
        seen = mesh if sides is None else sides.of(mesh)
        vertices = _finite(method, applied(method, parameters, removed.width, seen), numbers)
        for removal in removed.afterwards:
            vertices = without_finer(removal, seen, vertices)
        if edges is not None:
            vertices = smoothed_boundary(seen, edges, vertices)
        if finer is not None:
            vertices = seen.vertices + finer(vertices - seen.vertices)
        return vertices if sides is None else sides.joined(mesh, vertices)

    return step


def _finite(method: Method, vertices: Vectors, numbers: Ints) -> Vectors:
    bad = np.zeros(numbers.max() + 1, bool)
    bad[numbers[~all_in_rows(np.isfinite(vertices))]] = True
    if bad.any():
        raise DenoiseError(
            f"{method.name} returned {bad.sum()} vertices that are not finite (vertices {first_places(bad)})",
            hint="try weaker parameters, and please report the mesh",
        )
    return vertices


def _accumulated(step: Step, mesh: Mesh, strengths: NDArray[np.float64], known: list[Vectors] | None = None) -> Vectors:
    """Repeat a step on its own result; return the displacement of each vertex over as many steps as its strength.

    Results that are known are taken, and others are added to them.
    """
    has_lengths = mesh.mean_edge_length**2 > 0  # else the vertices of each face coincide
    times = math.ceil(strengths.max()) if has_lengths else 0
    displacement = np.zeros_like(mesh.vertices)
    for time in track(times):
        vertices = step(mesh) if known is None or time == len(known) else known[time]
        if known is not None and time == len(known):
            known.append(vertices)
        difference = vertices - mesh.vertices
        difference *= np.clip(strengths - time, 0.0, 1.0)[:, None]
        displacement += difference
        mesh = mesh.moved(vertices)
    return displacement


def _volume_preserving(
    mesh: Mesh, parts: Shells | None, displacement: Vectors, weights: NDArray[np.float64]
) -> Vectors:
    """Return a displacement after which closed components and regions have their volume; those of weight 0 stay."""
    if not displacement.any():
        return displacement
    vertices = mesh.vertices + displacement
    if parts is None:
        kept = with_volume_of(mesh, vertices, weights=weights)
    else:
        kept = with_region_volumes(parts, mesh, vertices, weights=weights)
    return np.where(weights[:, None] > 0, kept - mesh.vertices, 0.0)
