"""Apply a method to a mesh under the controls: its frame, creases, regions, boundary, detail, strength and limits."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.api.halo import Halo, check_halo, in_frame_of_whole
from cascadenorm.api.regions.shells import Shells, split_into_shells
from cascadenorm.api.regions.walls import joined_walls, with_region_volumes
from cascadenorm.compute.arrays import Bools, Floats, Ints, Ints32, Vectors, all_in_rows, first_places, marked
from cascadenorm.controls.boundary import boundary_edges, smoothed_boundary
from cascadenorm.controls.creases import crease_edges, cut_along
from cascadenorm.controls.detail import (
    DetailRemoval,
    apply_method,
    as_unknown_surface,
    high_pass_filter,
    without_detail,
)
from cascadenorm.controls.displacement import displace, framed_length
from cascadenorm.controls.sliding import sliding
from cascadenorm.controls.weights import vertex_weights
from cascadenorm.errors import DenoiseError, ParameterError
from cascadenorm.execution.progress import report_to, track
from cascadenorm.geometry.orientation import oriented
from cascadenorm.geometry.patches.work import free_derived
from cascadenorm.geometry.volume import closed_parts, volumes, with_volume_of
from cascadenorm.mesh import Mesh, in_frame, one_blas_thread
from cascadenorm.mesh.isolation import without_lines, without_repeated_faces
from cascadenorm.mesh.ordering import Renumbered, ordered_for_cache
from cascadenorm.registry import REGION, Method
from cascadenorm.registry.controls import CONTROLS, Controls

Step = Callable[[Mesh], Vectors]  # one application of a method and its controls, mapping a mesh to its new vertices
Note = Callable[[Vectors], None]  # receiver of the vertices that a method returned

JUDGING_METHOD = "auto"
"""Method whose displacements tell the kind of error of a mesh; it converges, so that it is applied only once."""

VOLUME_TOLERANCE = 1e-4  # change of a volume, as a share of it, that counts; more than single precision rounds


class Applied(NamedTuple):
    """A mesh to which a method was applied."""

    vertices: NDArray[Any]  # (n, 3), in the type that was asked for
    seen: Mesh  # the mesh in its frame
    shells: Shells | None  # surfaces of the regions of `seen`; None if no walls are shared
    exponent: int  # `seen` is scaled by 2**-exponent
    places: Ints32  # (n,) index of each vertex in `seen`
    # (n, 3) vertices of `seen` after the first application by JUDGING_METHOD, before all controls except
    # `remove_detail`; None for other methods, and if no vertex was to be moved
    denoised: Vectors | None
    is_cut: bool = False  # whether the method ran on a mesh that is cut along creases
    width: float | None = None  # of the detail to remove, in units of the frame; None if the method looked for steps

    @classmethod
    def elsewhere(
        cls, mesh: Mesh, vertices: NDArray[Any], removed: Vectors | None = None, whole: "Applied | None" = None
    ) -> "Applied":
        """Return vertices of a mesh that were computed otherwise, possibly as a part of a whole mesh.

        `removed` are the displacements by JUDGING_METHOD, (n, 3).
        """
        order, seen, parts, exponent = _prepared(without_lines(mesh), None)
        denoised = None if removed is None else seen.vertices + np.ldexp(removed[order.numbers], -exponent)
        applied = cls(vertices, seen, parts, exponent, order.places, denoised)
        if whole is None:
            return applied
        width = None if whole.width is None else float(np.ldexp(whole.width, whole.exponent - exponent))
        return applied._replace(is_cut=whole.is_cut, width=width)

    def seen_with(self, vertices: Vectors) -> Mesh:
        """Return `seen` with other vertices, (n, 3), given in the order and the unit of the mesh."""
        ordered = np.empty_like(vertices)
        ordered[self.places] = vertices
        return self.seen.moved(ordered)

    @property
    def surfaces(self) -> Mesh:
        """The surfaces that the method received: `seen`, or the shells of its regions."""
        return self.seen if self.shells is None else self.shells.mesh

    def changed_volumes(self, original: Vectors) -> tuple[int, int]:
        """Return the number of closed components and shells, and of those whose volume changed.

        `original`, (n, 3), are the vertices of the mesh.
        """
        parts = closed_parts(self.surfaces, may_touch=self.shells is not None)
        seen = (self.seen_with(np.ldexp(vertices, -self.exponent)) for vertices in (original, self.vertices))
        before, after = (volumes(mesh if self.shells is None else self.shells.of(mesh), parts) for mesh in seen)
        return parts.total, int((np.abs(after - before) > VOLUME_TOLERANCE * np.abs(before)).sum())

    @property
    def removed(self) -> Vectors | None:
        """(n, 3) displacements from the mesh to `denoised`, in the order and the unit of the mesh."""
        if self.denoised is None:
            return None
        return np.asarray(np.ldexp(self.denoised - self.seen.vertices, self.exponent)[self.places])


def run_with_controls(
    method: Method,
    mesh: Mesh,
    parameters: Mapping[str, Any],
    controls: Controls,
    *,
    dtype: Any = np.float64,
    steps: list[Vectors] | None = None,
) -> Applied:
    """Apply a method to a mesh under checked controls.

    The method receives the mesh centered at the origin, scaled by a power of two to about unit size, consistently
    oriented, without degenerate or repeated faces, and in a cache-friendly order. The displacement is added to the
    original coordinates. Coordinates far from the origin therefore lose no precision, and vertices that do not move, or
    that no face references, keep their exact bits.

    `steps` holds results of earlier applications of the method, which are reused; new ones are appended. Calls that
    share this list must have the same arguments, except for strengths of the same `step_key`.

    Raises ParameterError for a value that is out of range or does not fit the mesh, and DenoiseError if the method
    returned vertices that are not finite.
    """
    if REGION in parameters:
        raise ParameterError("is derived from the controls: pass mask, fixed or only", parameter=REGION)
    checked = method.checked(parameters)
    controls = {**controls, "strength": min(controls["strength"], MAX_STRENGTH)}
    faces, mesh = mesh.faces, without_lines(mesh)
    halo = None
    if controls["halo"] is not None:
        halo = check_halo(method, parameters, mesh, controls)
    order, framed, parts, exponent = _prepared(mesh, halo)
    for other in (mesh, order.mesh):
        if other.topology is not framed.topology:
            other.forget()  # the method reads the framed mesh only
    free_derived(framed)
    weights = vertex_weights(mesh, controls, faces)[order.numbers]
    if controls["boundary"] == "fixed":
        weights[boundary_edges(framed).vertices] = 0.0
    chosen = controls["mask"], controls["fixed"], controls["only"]
    if REGION in method.settings and (controls["boundary"] == "fixed" or any(one is not None for one in chosen)):
        checked[REGION] = weights > 0
    if halo is not None:
        weights = np.where(halo.vertices, 0.0, weights)
    limit = framed_length("max_displacement", controls["max_displacement"], framed, exponent)
    with one_blas_thread(), report_to(controls["progress"]):
        strength = min(controls["strength"], 1.0) if method.converges else controls["strength"]
        denoised = list[Vectors]()
        note = denoised.append if method.name == JUDGING_METHOD else None
        settings = StepSettings.of(method, checked, controls, framed, exponent)
        creases = _creases(framed, controls, order)
        step = _step(settings, framed, order.numbers, parts, creases, note)
        slides = None if controls["slide"] is None else sliding(framed)
        if slides is not None:
            step = partial(slides.slid, step)
        displacement = _accumulated(step, framed, strength * weights, steps)
        if controls["volume"] == "keep":
            displacement = _volume_preserving(framed, parts, displacement, weights)
            if slides is not None:
                displacement = slides.constrained(displacement)
    del step
    free_derived(mesh, order.mesh, framed)
    if controls["progress"] is not None:
        controls["progress"](1.0)
    vertices = displace(mesh, displacement[order.places], exponent=exponent, limit=limit, dtype=np.dtype(dtype))
    first = denoised[0] if denoised else None
    width, is_cut = settings.remove_detail, creases is not None
    return Applied(vertices, framed, parts, exponent, order.places, first, is_cut, width)


def step_key(method: Method, strength: float) -> float:
    """Return the part of a strength that changes each application of a method; the rest only blends the results."""
    return min(max(strength, 1.0), MAX_STRENGTH) if method.converges else 1.0


def _prepared(mesh: Mesh, halo: Halo | None) -> tuple[Renumbered, Mesh, Shells | None, int]:
    """Return the vertex order, the mesh in its frame, the shells of its regions, and the exponent of the frame."""
    if halo is None:
        framed, exponent = in_frame(mesh)
        order = ordered_for_cache(framed)
        return order, *split_into_shells(oriented(without_repeated_faces(order.mesh))), exponent
    return Renumbered.unchanged(mesh), in_frame_of_whole(mesh, halo.whole), None, halo.whole.frame.exponent


def reported_controls(controls: Controls) -> dict[str, Any]:
    """Return the controls that a report lists, as they were given; arrays are described by their shape."""
    return {name: _described(controls[name]) for name in CONTROLS if name not in UNREPORTED}  # type: ignore[literal-required]


WIDTH_STEP = 2.0
"""Increase in the width of removed detail, in mean edge lengths, per unit of strength above 1 (converging methods)."""

MAX_STRENGTH = 10.0  # upper limit of strength; larger values act as this one, because each unit is a further pass

UNREPORTED = ("strength", "threads", "progress", "halo")
"""Controls that a report omits: strength has its own field, halos apply to arrays only, and the others do not change
the result."""


def _described(value: Any) -> Any:
    array = np.asarray(value)
    return value if array.ndim == 0 or array.dtype.kind == "U" else f"array of shape {array.shape}"


class StepSettings(NamedTuple):
    """A method with its parameters and controls, with lengths in units of the frame."""

    method: Method
    parameters: Mapping[str, Any]
    controls: Controls
    keep_detail: float  # width of the smallest feature to keep
    remove_detail: float | None  # width of the errors that the method removes; None lets the method decide
    removals: list[DetailRemoval]  # detail to remove from the result of the method, in this order

    @classmethod
    def of(
        cls, method: Method, parameters: Mapping[str, Any], controls: Controls, framed: Mesh, exponent: int
    ) -> "StepSettings":
        """Convert the lengths to units of the frame.

        For a method that converges, each unit of strength above 1 adds one removal on the previous result. Each removal
        is WIDTH_STEP mean edge lengths wider than the last, and the last one may be partial. A larger strength thus
        extends a smaller one.
        """
        keep = framed_length("keep_detail", controls["keep_detail"], framed, exponent)
        remove = framed_length("remove_detail", controls["remove_detail"], framed, exponent)
        more = controls["strength"] - 1 if method.converges else 0.0
        step = WIDTH_STEP * framed.mean_edge_length
        removals = [DetailRemoval((k + 1) * step, min(more - k, 1.0)) for k in range(math.ceil(more))]
        detected = controls["remove_detail"] is None
        return cls(method, parameters, controls, keep, None if detected else remove, removals)

    def on_copies(self, owners: Ints) -> "StepSettings":
        """Return the settings for a mesh whose vertices are copies of the `owners`."""
        if REGION not in self.parameters:
            return self
        return self._replace(parameters={**self.parameters, REGION: self.parameters[REGION][owners]})


def _creases(mesh: Mesh, controls: Controls, order: Renumbered) -> Bools | None:
    """Return (e,) bool, the edges that are creases, or None if there are none."""
    creases = cast("float | ArrayLike | None", controls["creases"])  # files have been read already
    edges = None if creases is None else crease_edges(mesh, creases, order.places)
    return None if edges is None or not edges.any() else edges


def _step(
    settings: StepSettings, mesh: Mesh, numbers: Ints, parts: Shells | None, creases: Bools | None, note: Note | None
) -> Step:
    """Return the step that applies the method together with creases, boundary and detail to meshes with these faces.

    If regions share walls, the step runs on the shells of the regions, `parts`, and then joins the walls from their two
    sides. `numbers`, `creases` and `note` are those of `_surface_step`.
    """
    if parts is None:
        return _surface_step(settings, mesh, numbers, creases, note)
    edges = None if creases is None else parts.of_edges(mesh, creases)
    numbers = numbers[parts.owners]

    joined_note = None if note is None else lambda vertices: note(joined_walls(parts, mesh, vertices))
    each = _surface_step(settings.on_copies(parts.owners), parts.mesh, numbers, edges, joined_note)
    return lambda walls: joined_walls(parts, walls, each(parts.of(walls)))


def _surface_step(settings: StepSettings, mesh: Mesh, numbers: Ints, creases: Bools | None, note: Note | None) -> Step:
    """Return the step for a mesh without shared walls.

    `numbers`, (n,), are vertex indices in the input for messages; `creases`, (e,), mark the edges that are creases.
    `note`, if given, is called after the method, before the other controls.
    """
    # Cut the mesh along creases: the method and later stages see copies of the vertices there
    sides = None if creases is None else cut_along(mesh, creases)
    seen = mesh if sides is None else sides.mesh
    # Cutting creates boundaries everywhere; only one of the two networks of `auto` is trained for them
    if sides is not None:
        settings, numbers = settings.on_copies(sides.owners), numbers[sides.owners]
        settings = settings._replace(parameters=as_unknown_surface(settings.method, settings.parameters))
    method, parameters, controls = settings.method, settings.parameters, settings.controls

    # Boundary edges come from the uncut mesh, numbered as in the cut one; detail is smoothed on each side separately
    edges = boundary_edges(mesh, seen.faces) if controls["boundary"] == "smooth" else None
    finer = None if controls["keep_detail"] is None else high_pass_filter(settings.keep_detail, seen)

    def step(mesh: Mesh) -> Vectors:
        seen = mesh if sides is None else sides.of(mesh)
        vertices = _finite(method, apply_method(method, parameters, settings.remove_detail, seen), numbers)
        if note is not None:
            note(vertices if sides is None else sides.joined(mesh, vertices))
        for removal in settings.removals:
            vertices = without_detail(removal, seen, vertices)
        if edges is not None:
            vertices = smoothed_boundary(seen, edges, vertices)
        if finer is not None:
            vertices = seen.vertices + finer(vertices - seen.vertices)
        return vertices if sides is None else sides.joined(mesh, vertices)

    return step


def _finite(method: Method, vertices: Vectors, numbers: Ints) -> Vectors:
    bad = marked(numbers[~all_in_rows(np.isfinite(vertices))], int(numbers.max()) + 1)
    if bad.any():
        raise DenoiseError(
            f"{method.name} returned {bad.sum()} vertices that are not finite (vertices {first_places(bad)})",
            hint="try weaker parameters, and please report the mesh",
        )
    return vertices


def _accumulated(step: Step, mesh: Mesh, strengths: Floats, known: list[Vectors] | None = None) -> Vectors:
    """Apply a step repeatedly and return the displacement of each vertex over as many steps as its strength.

    Results in `known` are reused, and new results are appended to it.
    """
    displacement = np.zeros(mesh.vertices.shape)  # unlike `zeros_like`, takes no memory before it is written
    for time in track(math.ceil(strengths.max())):
        if not mesh.mean_edge_length**2 > 0:  # the vertices of each face coincide
            continue
        vertices = step(mesh) if known is None or time == len(known) else known[time]
        if known is not None and time == len(known):
            known.append(vertices)
        difference = vertices - mesh.vertices
        difference *= np.clip(strengths - time, 0.0, 1.0)[:, None]
        displacement += difference
        mesh = mesh.moved(vertices)
    return displacement


def _volume_preserving(mesh: Mesh, parts: Shells | None, displacement: Vectors, weights: Floats) -> Vectors:
    """Return a displacement that preserves the volume of closed components and regions; vertices of weight 0 stay."""
    if not displacement.any():
        return displacement
    vertices = mesh.vertices + displacement
    if parts is None:
        kept = with_volume_of(mesh, vertices, weights=weights)
    else:
        kept = with_region_volumes(parts, mesh, vertices, weights=weights)
    return np.where(weights[:, None] > 0, kept - mesh.vertices, 0.0)
