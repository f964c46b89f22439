"""What surrounds every method: its frame of coordinates, strength, mask, fixed vertices, rims, limits, volume."""

import math
import numbers
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.controls.boundary import along_the_rim, rim_of
from cascadenorm.controls.creases import crease_edges, cut
from cascadenorm.controls.detail import finer_than
from cascadenorm.geometry.orientation import oriented
from cascadenorm.geometry.volume import with_volume_of
from cascadenorm.mesh import Mesh, Vectors, first_places, in_frame, one_blas_thread, without_lines
from cascadenorm.progress import report_to, track
from cascadenorm.registry import REGION, Method, ParameterError

Boundary = Literal["free", "smooth", "fixed"]


class DenoiseError(RuntimeError):
    """A method that gave no usable vertices."""


@dataclass(frozen=True, kw_only=True)
class Controls:
    """How much of a method is applied, where, and within which limits.

    Parameters
    ----------
    strength : 0 nothing, 1 the method; between them x + s (f(x) - x); above 1 the method is applied again to what
        came out: y = f(x), then y + (s - 1)(f(y) - y), and so on
    mask : (n,) bool, or numbers from 0 to 1 by which the strength is multiplied at each vertex; None: everywhere
    fixed : (n,) bool, or numbers of vertices, that stay where they are
    only : (m,) bool, or numbers of faces: vertices all of whose faces are among them move, the others stay
    boundary : of the vertices on an edge with a single face. "free": they go where the method moves them; "smooth": so
        they do off the surface, and along it the rim is smoothed as a curve with its corners kept (see
        `along_the_rim`); "fixed": they stay
    creases : edges across which the method must not mix: (k, 2) pairs of vertices, or an angle in degrees, and edges
        whose faces include a larger one are creases; the method sees the mesh cut along them, and its sides are
        joined again (see `cut`, `Sides.joined`)
    keep_detail : the smallest feature to keep, a length in the mesh's own unit or as text in mean edge lengths; of what
        the method moves, only what is finer is applied (see `finer_than`); 0 keeps everything, None leaves it to the
        method
    max_displacement : no vertex moves farther than this; in the mesh's own unit, or as text in mean edge lengths:
        "0.5 edges"
    volume : "keep" scales every closed part about its centroid to the volume that it had; masked and fixed vertices
        stay, and the limit on displacement comes last
    threads : at most this many; None: as many as there are. The result is the same
    progress : called with the share that is done, from 0 to 1; what it raises ends the work
    """

    strength: float = 1.0
    mask: ArrayLike | None = None
    fixed: ArrayLike | None = None
    only: ArrayLike | None = None
    boundary: Boundary = "free"
    creases: float | ArrayLike | None = None
    keep_detail: float | str | None = None
    max_displacement: float | str | None = None
    volume: Literal["keep"] | None = None
    threads: int | None = None
    progress: Callable[[float], object] | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.strength, numbers.Real) and 0 <= self.strength < math.inf):
            raise ParameterError(f"strength is {self.strength!r}; it must be a finite number, at least 0")
        if self.boundary not in get_args(Boundary):
            raise ParameterError(f"boundary is {self.boundary!r}; it must be one of {', '.join(get_args(Boundary))}")
        if self.volume not in (None, "keep"):
            raise ParameterError(f"volume is {self.volume!r}; it must be 'keep' or None")
        if self.threads is not None and not (isinstance(self.threads, numbers.Integral) and self.threads >= 1):
            raise ParameterError(f"threads is {self.threads!r}; it must be a whole number, at least 1, or None for all")
        for name in ("keep_detail", "max_displacement"):
            _read_length(name, getattr(self, name))

    @property
    def hold_some(self) -> bool:
        """Whether some vertices may have to stay."""
        return any(a is not None for a in (self.mask, self.fixed, self.only)) or self.boundary == "fixed"

    def in_words(self) -> dict[str, Any]:
        """Return all but strength, threads and progress by name, as they were given; of an array only its shape."""
        names = (f.name for f in fields(self) if f.name not in ("strength", "threads", "progress"))
        return {name: _in_words(getattr(self, name)) for name in names}


def _in_words(value: Any) -> Any:
    array = np.asarray(value)
    return value if array.ndim == 0 or array.dtype.kind == "U" else f"array of shape {array.shape}"


def controlled(
    method: Method, mesh: Mesh, parameters: Mapping[str, Any], controls: Controls, *, dtype: Any = np.float64
) -> NDArray[Any]:
    """Apply a method to a mesh under the given controls.

    The method sees the mesh around the origin, scaled by a power of two to about unit size; what it moves is added to
    the vertices as they were. So coordinates far from the origin lose nothing, and a vertex that does not move, or
    that no face uses, keeps its bits. Faces that are wound against their neighbours are turned for the method alone;
    those that name a vertex twice it does not see.

    Returns
    -------
    (n, 3) of the given type, a copy

    Raises
    ------
    ParameterError : a parameter, mask or limit that is out of range or does not fit the mesh
    DenoiseError : the method gave vertices that are not finite
    """
    if REGION in parameters:
        raise ParameterError(f"{REGION} is not set by itself: give a mask, or fixed vertices")
    checked = method.checked(parameters)
    given, mesh = mesh, without_lines(mesh)
    weights = _weights(mesh, controls, given.faces)
    if REGION in method.settings and controls.hold_some:
        checked[REGION] = weights > 0
    framed, exponent = in_frame(mesh)
    keep = (
        None if controls.keep_detail is None else framed_length("keep_detail", controls.keep_detail, framed, exponent)
    )
    framed = oriented(framed)
    with one_blas_thread():
        application = _application(method, framed, checked, controls, keep)
        displacement = _displacement(application, framed, controls.strength * weights, controls.progress)
        if controls.volume == "keep" and displacement.any():
            kept = with_volume_of(framed, framed.vertices + displacement, weights=weights)
            displacement = np.where(weights[:, None] > 0, kept - framed.vertices, 0.0)
    limit = framed_length("max_displacement", controls.max_displacement, framed, exponent)
    return _moved(mesh, displacement, exponent, limit, np.dtype(dtype))


def _weights(mesh: Mesh, controls: Controls, faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Share of the strength at each vertex: the mask, less what is fixed, other regions, and what no face uses.

    `only` counts the faces given, which may be more than those of the mesh.
    """
    count = len(mesh.vertices)
    weights = np.zeros(count)
    weights[mesh.faces] = 1.0
    if controls.mask is not None:
        mask = np.asarray(controls.mask)
        if mask.shape != (count,) or mask.dtype.kind not in "biuf":
            raise ParameterError(
                f"mask has shape {mask.shape} and type {mask.dtype}; it must be ({count},) bool or 0…1"
            )
        bad = np.asarray(~((mask >= 0) & (mask <= 1)))
        if bad.any():
            raise ParameterError(
                f"{bad.sum()} weights of the mask are not within 0 … 1 (vertices {first_places(bad)}): scale them"
            )
        weights *= mask
    if controls.fixed is not None:
        weights[_rows("fixed", np.asarray(controls.fixed), count, "vertex", "vertices")] = 0.0
    if controls.only is not None:
        weights[faces[~faces_within(controls.only, len(faces))]] = 0.0
    if controls.boundary == "fixed":
        weights[rim_of(mesh).vertices] = 0.0
    return weights


def faces_within(only: ArrayLike, count: int) -> NDArray[np.bool_]:
    """Return (count,) which faces are among those given, by numbers or by (count,) bool.

    Raises
    ------
    ParameterError : neither of both, or a number that is not in 0 … count - 1
    """
    within = np.zeros(count, bool)
    within[_rows("only", np.asarray(only), count, "face", "faces")] = True
    return within


def _rows(name: str, rows: NDArray[Any], count: int, one: str, several: str) -> NDArray[Any]:
    """Return vertices or faces that are given by numbers or by (count,) bool."""
    if rows.dtype == bool and rows.shape == (count,):
        return rows
    if rows.ndim != 1 or (rows.dtype.kind not in "iu" and rows.size > 0):
        raise ParameterError(
            f"{name} has shape {rows.shape} and type {rows.dtype}; it must be ({count},) bool or numbers of {several}"
        )
    bad = (rows < 0) | (rows >= count)
    if bad.any():
        raise ParameterError(f"{name} names {one} {rows[bad][0]}; there are {count} {several}, counted from 0")
    return rows.astype(np.int64)


def _application(
    method: Method, mesh: Mesh, parameters: Mapping[str, Any], controls: Controls, keep: float | None
) -> Callable[[Mesh], Vectors]:
    """Return the method, and what the controls do each time after it, as a function from a mesh to its vertices.

    `keep` is the smallest feature to keep, in the unit of the mesh.
    """
    sides = None if controls.creases is None else cut(mesh, crease_edges(mesh, controls.creases))
    if sides is not None and REGION in parameters:
        parameters = {**parameters, REGION: parameters[REGION][sides.owners]}
    rim = rim_of(mesh, mesh.faces if sides is None else sides.mesh.faces) if controls.boundary == "smooth" else None
    finer = None if keep is None else finer_than(keep, mesh if sides is None else sides.mesh)

    def application(mesh: Mesh) -> Vectors:
        seen = mesh if sides is None else sides.of(mesh)
        vertices = _finite(method, method.function(seen, **parameters))
        if rim is not None:
            vertices = along_the_rim(seen, rim, vertices)
        if finer is not None:
            vertices = seen.vertices + finer(vertices - seen.vertices)
        return vertices if sides is None else sides.joined(mesh, vertices)

    return application


def _finite(method: Method, vertices: Vectors) -> Vectors:
    bad = np.asarray(~np.isfinite(vertices).all(axis=1))
    if bad.any():
        raise DenoiseError(
            f"{method.name} gave {bad.sum()} vertices that are not finite (vertices {first_places(bad)}): "
            "try milder parameters, and report the mesh"
        )
    return vertices


def _displacement(
    application: Callable[[Mesh], Vectors],
    mesh: Mesh,
    strengths: NDArray[np.float64],
    progress: Callable[[float], object] | None,
) -> Vectors:
    """Apply the method again and again; each vertex follows as far as its own strength says."""
    has_lengths = mesh.mean_edge_length**2 > 0  # else all corners of each face are in one place
    times = math.ceil(strengths.max()) if has_lengths else 0
    displacement = np.zeros_like(mesh.vertices)
    with report_to(progress):
        for time in track(times):
            vertices = application(mesh)
            displacement += np.clip(strengths - time, 0.0, 1.0)[:, None] * (vertices - mesh.vertices)
            mesh = mesh.moved(vertices)
    if progress is not None:
        progress(1.0)
    return displacement


def _read_length(name: str, text: float | str | None) -> tuple[float, bool]:
    """Return a length, and whether it counts mean edge lengths; None is without end."""
    if text is None:
        return math.inf, False
    match = re.fullmatch(r"\s*([^\s]+?)\s*(edges?)?\s*", str(text))
    try:
        length = float(match[1]) if match else math.nan
    except ValueError:
        length = math.nan
    if math.isnan(length) or length < 0:
        raise ParameterError(f'{name} is {text!r}; it must be a length, at least 0, or like "0.5 edges"')
    return length, bool(match and match[2])


def framed_length(name: str, text: float | str | None, framed: Mesh, exponent: int) -> float:
    """Return a length in the unit of the frame, 2**exponent of the mesh's own; None is without end."""
    length, in_edges = _read_length(name, text)
    with np.errstate(over="ignore"):  # far larger than the mesh is without end
        return length * framed.mean_edge_length if in_edges else float(np.ldexp(length, -exponent))


def _moved(mesh: Mesh, displacement: Vectors, exponent: int, limit: float, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Add the displacement to the vertices; in the type of the result none is longer than the limit."""
    limit *= 1 - 8 * float(np.finfo(dtype).eps)  # so that it holds as well when measured in that type
    length = np.linalg.norm(displacement, axis=1, keepdims=True)
    long = length[:, 0] > limit
    displacement[long] *= limit / length[long]
    before = mesh.vertices.astype(dtype)
    with np.errstate(over="ignore"):
        step = np.ldexp(displacement, exponent)
        after = np.where(step != 0, mesh.vertices + step, mesh.vertices).astype(dtype)
    bad = ~np.isfinite(after).all(axis=1)
    if bad.any():
        raise DenoiseError(
            f"{bad.sum()} vertices would go beyond what {dtype} can hold (vertices {first_places(bad)}): "
            "scale the mesh down first"
        )
    while True:  # rounding may have gone past the limit: come back by single steps of the number type
        taken = np.ldexp(after.astype(np.float64) - before.astype(np.float64), -exponent)
        long = np.linalg.norm(taken, axis=1) > limit
        if not long.any():
            return after
        after[long] = np.nextafter(after[long], before[long])
