"""Sample a field on a lattice, which may be jittered, only near the surface."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from cascadenorm.data_gen.shapes.fields import DistanceField, Values
from cascadenorm.mesh import Vectors

BLOCK_CELLS = 4  # lattice cells along a side of the blocks that are skipped or evaluated as a whole
LARGEST_GRADIENT = 1.6  # assumed bound on the gradient of a field; blocks without surface under this bound are skipped


class Lattice(NamedTuple):
    """Nodes (p, q, r, 3) and the values of the field (p, q, r) there; `spacing` is the edge length of the lattice."""

    nodes: NDArray[np.float64]
    values: NDArray[np.float64]
    spacing: float


def sample(
    field: DistanceField,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    spacing: float,
    jitter: float = 0.0,
    turn: Vectors | None = None,
    open_boundary: bool = False,
    rng: np.random.Generator,
) -> Lattice:
    """Evaluate a field on a lattice over the box from `lower` to `upper`, with edges of the mean length `spacing`.

    The jitter is the largest random displacement of the nodes, relative to the spacing, and `turn` rotates the axes of
    the lattice about the middle of the box. With an open boundary, the lattice is the rotated box itself, and the
    surface ends at its border instead of being closed there.
    """
    lower, upper = np.asarray(lower, np.float64), np.asarray(upper, np.float64)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    if turn is not None and not open_boundary:
        half = np.abs(turn.T) @ half
    nodes = grid(half, np.full(3, spacing), cells=BLOCK_CELLS)
    if jitter > 0:
        nodes += rng.uniform(-jitter, jitter, nodes.shape) * spacing
    nodes = (nodes if turn is None else nodes @ turn.T) + middle
    reach = 0.5 * LARGEST_GRADIENT * BLOCK_CELLS * np.sqrt(3) * spacing * (1 + jitter)
    values = _values(field, nodes, reach=reach)
    if not open_boundary:
        boundary = np.ones(values.shape, bool)
        boundary[1:-1, 1:-1, 1:-1] = False
        values[boundary] = np.maximum(values[boundary], 0.3 * spacing)
    return Lattice(nodes, values, spacing)


def grid(half: NDArray[np.float64], steps: NDArray[np.float64], *, cells: int = 1) -> NDArray[np.float64]:
    """Return nodes about the origin that cover the box from -half to half, (p, q, r, 3), `steps` apart along the axes.

    The number of steps along each axis is a multiple of `cells`.
    """
    counts = cells * np.ceil(2 * half / (cells * steps)).astype(int) + 1
    axes = [step * (np.arange(count) - 0.5 * (count - 1)) for step, count in zip(steps, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def trilinear(at: Vectors, shape: tuple[int, ...]) -> sparse.csr_array:
    """Return the matrix (n, p q r) that interpolates values at nodes, (p, q, r), to points given in cells."""
    low = np.clip(np.floor(at).astype(np.int64), 0, np.array(shape) - 2)
    part = at - low
    rows, columns, values = [], [], []
    for corner in np.ndindex(2, 2, 2):
        rows.append(np.arange(len(at)))
        columns.append(np.ravel_multi_index(tuple((low + corner).T), shape))
        values.append(np.where(corner, part, 1 - part).prod(axis=1))
    size = (len(at), int(np.prod(shape)))
    return sparse.csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=size)


def _values(field: DistanceField, nodes: NDArray[np.float64], *, reach: float) -> Values:
    """Evaluate at the corners of blocks, then everywhere in the blocks that the surface may cross."""
    corners = nodes[::BLOCK_CELLS, ::BLOCK_CELLS, ::BLOCK_CELLS]
    coarse = field(corners.reshape(-1, 3)).reshape(corners.shape[:3])
    ends = np.lib.stride_tricks.sliding_window_view(coarse, (2, 2, 2))
    active = (ends.min(axis=(3, 4, 5)) < reach) & (ends.max(axis=(3, 4, 5)) > -reach)
    spread = active.repeat(BLOCK_CELLS, 0).repeat(BLOCK_CELLS, 1).repeat(BLOCK_CELLS, 2)
    wanted = np.zeros(nodes.shape[:3], bool)
    for a, b, c in np.ndindex(2, 2, 2):
        wanted[a : a + spread.shape[0], b : b + spread.shape[1], c : c + spread.shape[2]] |= spread
    last = [slice(0, count) for count in nodes.shape[:3]]
    values = coarse.repeat(BLOCK_CELLS, 0).repeat(BLOCK_CELLS, 1).repeat(BLOCK_CELLS, 2)[tuple(last)].copy()
    values[wanted] = field(nodes[wanted])
    return values
