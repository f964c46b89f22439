"""How far vertices go: lengths in the frame, the limit on displacement, and rounding that respects it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.controls.settings import Length, parsed_length
from cascadenorm.errors import DenoiseError
from cascadenorm.mesh import Mesh, Vectors, all_in_rows, first_places


def framed_length(name: str, length: Length | None, framed: Mesh, exponent: int) -> float:
    """Return a length in the unit of the frame, 2**exponent of the mesh's own; None is infinite."""
    number, in_edges = parsed_length(name, length)
    with np.errstate(over="ignore"):  # a length far beyond the size of the mesh may become infinite
        return number * framed.mean_edge_length if in_edges else float(np.ldexp(number, -exponent))


def shortened(displacement: Vectors, limit: float) -> Vectors:
    """Return the displacement with longer vectors shortened to the limit."""
    if limit == np.inf:
        return displacement
    length = np.linalg.norm(displacement, axis=1, keepdims=True)
    long = length[:, 0] > limit
    out = displacement.copy()
    out[long] *= limit / length[long]
    return out


def displaced(mesh: Mesh, displacement: Vectors, *, exponent: int, limit: float, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Add a displacement of the frame to the vertices of the mesh, in the type of the result.

    Parameters
    ----------
    mesh
        n vertices in their own coordinates; those with displacement 0 keep their bits.
    displacement
        (n, 3) in units of 2**exponent.
    limit
        In the same unit; no vertex moves farther in the type of the result either.

    Raises
    ------
    DenoiseError
        A vertex would leave the range of the type.
    """
    limit *= 1 - 8 * float(np.finfo(dtype).eps)  # so that it also holds when measured in that type
    with np.errstate(over="ignore"):
        step = np.ldexp(shortened(displacement, limit), exponent)
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
    while limit < np.inf:  # rounding may have passed the limit: come back by single steps of the number type
        taken = np.ldexp(after.astype(np.float64) - before.astype(np.float64), -exponent)
        long = np.linalg.norm(taken, axis=1) > limit
        if not long.any():
            return after
        after[long] = np.nextafter(after[long], before[long])
    return after
