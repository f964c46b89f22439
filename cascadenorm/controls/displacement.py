"""Apply and limit vertex displacements, including rounding to the result type."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import DenoiseError
from cascadenorm.mesh import Mesh, Vectors, all_in_rows, first_places
from cascadenorm.registry.controls import Length, parsed_length


def framed_length(name: str, length: Length | None, framed: Mesh, exponent: int) -> float:
    """Convert a length to units of the frame, which are 2**exponent mesh units; None is infinite."""
    number, in_edges = parsed_length(name, length)
    with np.errstate(over="ignore"):  # a length far beyond the size of the mesh may become infinite
        return number * framed.mean_edge_length if in_edges else float(np.ldexp(number, -exponent))


def clip_lengths(displacement: Vectors, limit: float) -> Vectors:
    """Return the displacement with vectors longer than the limit shortened to it."""
    if limit == np.inf:
        return displacement
    length = np.linalg.norm(displacement, axis=1, keepdims=True)
    long = length[:, 0] > limit
    out = displacement.copy()
    out[long] *= limit / length[long]
    return out


def displace(mesh: Mesh, displacement: Vectors, *, exponent: int, limit: float, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Add a displacement, (n, 3) in units of 2**exponent, to the vertices; return them in the type of the result.

    Vertices with displacement 0 keep their exact bits. The limit, in the same unit, also holds after rounding to the
    type of the result. Raises DenoiseError if a vertex would exceed the range of the type.
    """
    limit *= 1 - 8 * float(np.finfo(dtype).eps)  # so that the limit also holds when measured in that type
    with np.errstate(over="ignore"):
        step = np.ldexp(clip_lengths(displacement, limit), exponent)
        moved = mesh.vertices + step
        np.copyto(moved, mesh.vertices, where=step == 0)
        after = moved.astype(dtype, copy=False)
    bad = ~all_in_rows(np.isfinite(after))
    if bad.any():
        raise DenoiseError(
            f"{bad.sum()} vertices would exceed the range of {dtype} (vertices {first_places(bad)})",
            hint="scale the mesh down first",
        )
    before = mesh.vertices.astype(dtype, copy=False)
    while limit < np.inf:  # rounding may exceed the limit: step back by single units in the last place
        taken = np.ldexp(after.astype(np.float64) - before.astype(np.float64), -exponent)
        long = np.linalg.norm(taken, axis=1) > limit
        if not long.any():
            return after
        after[long] = np.nextafter(after[long], before[long])
    return after
