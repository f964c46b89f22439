"""The stages of a cascade on a GPU: filters, regression and vertex update once more, in torch.

Sums over neighbours have one writer and go in the order of the neighbours, so that a GPU, too, gives the same bytes
each time. Only what takes the time is here: topology and geometry come from the processor.
"""

from collections.abc import Callable, Iterator
from functools import wraps
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from cascadenorm.baselines.iterated_bilateral import range_steepness, ring_weights
from cascadenorm.baselines.smoothed_normals import vertex_directions
from cascadenorm.baselines.vertex_update import Foldovers, Weighting, face_weights, over_relaxation
from cascadenorm.learned.descriptors import Filters, Stack
from cascadenorm.learned.engine import Engine
from cascadenorm.learned.features import CONTEXT_STEPS, component_means, openness
from cascadenorm.learned.networks import ACTIVATIONS, TorchFeatures
from cascadenorm.learned.regression import Regression
from cascadenorm.mesh import Csr, Mesh, Vectors, unit
from cascadenorm.progress import track
from cascadenorm.registry import ParameterError

ROWS = 1 << 17
"""Faces or vertices in one piece of work, so that what lies between neighbours fits into the memory of any GPU."""


def engine(device: str) -> Engine:
    """Return what computes stages on a device of torch, "cuda" or another.

    Raises
    ------
    ParameterError : it is a GPU, and torch finds none
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise ParameterError(
            f"device is 'cuda', but torch {torch.__version__} finds no GPU that it can use: "
            "leave the device out to compute on the processor"
        )
    iterated, smoothed, regressed, recovered = (
        _on(torch.device(device), work) for work in (_iterated_bilateral, _smoothed_normals, _regressed, _recovered)
    )
    return Engine(Filters(iterated, smoothed), regressed, recovered)


def _on(device: torch.device, work: Callable[..., NDArray[Any]]) -> Callable[..., NDArray[Any]]:
    """Bind work to a device; too little memory there is a MemoryError, as on the processor."""

    @wraps(work)
    def done(*arguments: Any, **settings: Any) -> NDArray[Any]:
        try:
            with torch.no_grad():
                return work(device, *arguments, **settings)
        except torch.cuda.OutOfMemoryError as error:
            raise MemoryError(str(error)) from None

    return done


class _Part(NamedTuple):
    """Some rows of `_Rows`, which numbers are in them, and where each begins there."""

    rows: slice
    entries: slice
    offsets: Tensor

    @property
    def counts(self) -> Tensor:
        """Length of each row, (rows, 1)."""
        return torch.diff(self.offsets)[:, None]

    def own(self, values: Tensor) -> Tensor:
        """Repeat the value of each row for each number in it."""
        entries = self.entries.stop - self.entries.start
        return values[self.rows].repeat_interleave(self.counts[:, 0], dim=0, output_size=entries)

    def sums(self, values: Tensor) -> Tensor:
        """Add what belongs to the numbers of each row, in their order."""
        return torch.segment_reduce(values, "sum", offsets=self.offsets, axis=0, initial=0)


class _Rows:
    """A CSR on a device, each row after its own number, read in parts."""

    def __init__(self, csr: Csr, device: torch.device) -> None:
        self.indptr = csr.indptr + np.arange(len(csr.indptr))
        self.offsets = torch.tensor(self.indptr, device=device)
        self.indices = self.filled(torch.arange(len(csr.counts), device=device), csr.indices)

    def filled(self, own: Tensor, others: NDArray[Any]) -> Tensor:
        """Put what each row itself has before what its entries have."""
        out = torch.empty(int(self.indptr[-1]), dtype=own.dtype, device=own.device)
        first = torch.zeros(len(out), dtype=torch.bool, device=own.device)
        first[self.offsets[:-1]] = True
        out[first] = own
        out[~first] = torch.tensor(others, device=own.device).to(own.dtype)
        return out

    def __iter__(self) -> Iterator[_Part]:
        count = len(self.indptr) - 1
        for start, stop in pairwise([*range(0, count, ROWS), count]):
            offsets = self.offsets[start : stop + 1]
            entries = slice(int(self.indptr[start]), int(self.indptr[stop]))
            yield _Part(slice(start, stop), entries, offsets - offsets[0])


def _dot(a: Tensor, b: Tensor) -> Tensor:
    """Products along axis 1, which has 3 entries, added in their order as the kernels of the processor do."""
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


def _cross(a: Tensor, b: Tensor) -> Tensor:
    """Cross product of rows, each product rounded, so that it vanishes where the rows are parallel."""
    (ax, ay, az), (bx, by, bz) = a.unbind(dim=1), b.unbind(dim=1)
    return torch.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], dim=1)


def _eighth_power(x: Tensor) -> Tensor:
    return x.square().square().square()


def _iterated_bilateral(
    device: torch.device,
    mesh: Mesh,
    *,
    sigma_r: tuple[float, ...],
    passes: tuple[int, ...],
    out: Stack | None = None,
) -> Stack:
    """As `iterated_bilateral.iterated_bilateral_normals`, to the last digit."""
    csr, own, others = ring_weights(mesh)
    rings = _Rows(csr, device)
    weights = rings.filled(torch.tensor(own, device=device), others)[:, None]
    steepness = torch.tensor(range_steepness(sigma_r), device=device)
    first = torch.tensor(mesh.normals, dtype=torch.float32, device=device)
    normals = first[:, :, None].repeat(1, 1, len(sigma_r))
    kept, after = [first[:, None]], torch.empty_like(normals)
    for done in track(passes[-1]):
        for part in rings:
            near = normals[rings.indices[part.entries]]
            apart = near - part.own(normals)
            share = weights[part.entries] * _eighth_power((1 - steepness * _dot(apart, apart)).clamp(min=0))
            total = part.sums(share[:, None] * near)
            length = _dot(total, total).double().sqrt().float()[:, None]  # torch's own may miss the last bit
            after[part.rows] = torch.where(length > 0, total / length, normals[part.rows])
        normals, after = after, normals
        if done + 1 in passes:
            kept.append(normals.transpose(1, 2).clone())
    return _stored(torch.cat(kept, dim=1), out)


def _smoothed_normals(
    device: torch.device,
    mesh: Mesh,
    along: Vectors | NDArray[np.float32],
    passes: tuple[int, ...],
    *,
    sigma_r: float = np.inf,
    out: Stack | None = None,
) -> Stack:
    """As `smoothed_normals.smoothed_normals`, to the last digit."""
    directions = torch.tensor(vertex_directions(mesh, along), device=device)
    neighbors, spread = _Rows(mesh.topology.vertex_neighbors, device), 0.5 / sigma_r**2
    positions, faces = torch.tensor(mesh.vertices, device=device), torch.tensor(mesh.faces, device=device).long()
    otherwise, kept = torch.tensor(mesh.normals, device=device), []
    for done in range(1, passes[-1] + 1):
        after = torch.empty_like(positions)
        for part in neighbors:
            others, own = neighbors.indices[part.entries], part.own(directions)
            rise, apart = _dot(own, positions[others] - part.own(positions)), directions[others] - own
            weight = _eighth_power((1 - 0.125 * spread * _dot(apart, apart)).clamp(min=0))
            sums = part.sums(torch.stack([weight * rise, weight], dim=1))
            after[part.rows] = positions[part.rows] + sums[:, :1] / sums[:, 1:] * directions[part.rows]
        positions = after
        if done in passes:
            a, b, c = positions[faces].unbind(dim=1)
            area = _cross(b - a, c - a)
            length = _dot(area, area).sqrt()[:, None]
            kept.append(torch.where(length > 0, area / length, otherwise).float())
    return _stored(torch.stack(kept, dim=1), out)


def _stored(found: Tensor, out: Stack | None) -> Stack:
    """Return an array on the processor: the one given, if one is."""
    stack = found.cpu().numpy()
    if out is None:
        return stack
    out[:] = stack
    return out


def _regressed(device: torch.device, stage: Regression, mesh: Mesh, stack: Stack) -> Vectors:
    """As `Regression.normals`."""
    scaler, features = stage.scaler, TorchFeatures(stage.scaler, device)
    normals, activate = torch.tensor(stack, device=device), ACTIVATIONS[stage.settings.activation]
    centers, projection = (torch.tensor(array, device=device) for array in (stage.centers, scaler.projection))
    layers = [(torch.tensor(weight, device=device), torch.tensor(bias, device=device)) for weight, bias in stage.layers]
    parts = [slice(start, start + ROWS) for start in range(0, len(stack), ROWS)]
    context = torch.empty(len(stack), 0, device=device)
    if scaler.projection.size:
        context = _context_features(torch.cat([features.own(normals[rows]) @ projection for rows in parts]), mesh)
    total = []
    for rows in parts:
        x = features(normals[rows], context[rows])
        cluster = (centers.square().sum(dim=1) - 2 * x @ centers.T).argmin(dim=1)
        coefficients = torch.empty(len(x), stack.shape[1], device=device)
        for c in range(len(centers)):
            mine = cluster == c
            y = x[mine]
            for weight, bias in layers[:-1]:
                y = activate(y @ weight[c] + bias[c])
            coefficients[mine] = y @ layers[-1][0][c] + layers[-1][1][c]
        total.append((coefficients[:, :, None] * normals[rows]).sum(dim=1))
    return unit(torch.cat(total).cpu().numpy(), otherwise=stack[:, 0])


def _context_features(values: Tensor, mesh: Mesh) -> Tensor:
    """As `features.context_features` and `openness`, which stand last."""
    mean = torch.tensor(component_means(values.cpu().numpy(), mesh), device=values.device)
    rings, kept = _Rows(mesh.topology.face_rings(1), values.device), []
    for done in range(1, CONTEXT_STEPS[-1] + 1):
        after = torch.empty_like(values)
        for part in rings:
            after[part.rows] = part.sums(values[rings.indices[part.entries]]) / part.counts
        values = after
        if done in CONTEXT_STEPS:
            kept.append(values)
    return torch.cat([*kept, mean, torch.tensor(openness(mesh)[:, None], device=values.device)], dim=1)


class _Group(NamedTuple):
    """Vertices of which no two share a face, and the faces around them, vertex after vertex."""

    vertices: Tensor
    corners: Tensor
    """Of each face: that vertex, the next, the last."""
    normals: Tensor
    weights: Tensor
    around: _Part


def _groups(device: torch.device, mesh: Mesh, normals: Vectors, weights: NDArray[np.float64]) -> Iterator[_Group]:
    """Gather for each group of `Topology.vertex_colors` what its vertices see."""
    around, colors = mesh.topology.vertex_faces, mesh.topology.vertex_colors
    for color in range(len(colors.counts)):
        mine = colors.row(color)
        counts = around.counts[mine]
        offsets = np.concatenate([[0], np.cumsum(counts)])
        faces = around.indices[np.arange(offsets[-1]) + np.repeat(around.indptr[mine] - offsets[:-1], counts)]
        corners = mesh.faces[faces]
        first = (corners == np.repeat(mine, counts)[:, None]).argmax(axis=1)
        rotated = np.take_along_axis(corners, (first[:, None] + np.arange(3)) % 3, axis=1).T
        yield _Group(
            torch.tensor(mine, device=device).long(),
            torch.tensor(rotated, device=device).long(),
            torch.tensor(normals[faces], device=device),
            torch.tensor(weights[faces], device=device),
            _Part(slice(0, len(mine)), slice(0, len(faces)), torch.tensor(offsets, device=device)),
        )


def _recovered(
    device: torch.device,
    mesh: Mesh,
    normals: Vectors,
    *,
    sweeps: int = 20,
    weighting: Weighting = "heights",
    foldovers: Foldovers = "avoid",
) -> Vectors:
    """As `vertex_update.recover_vertices`."""
    positions = torch.tensor(mesh.vertices, device=device)
    groups = list(_groups(device, mesh, normals, face_weights(mesh, weighting)))
    for _ in range(sweeps):
        for group in groups:
            positions[group.vertices] += _step(group, positions, over_relaxation(weighting), foldovers)
    return positions.cpu().numpy()


def _step(group: _Group, positions: Tensor, relaxation: float, foldovers: Foldovers) -> Tensor:
    """Return how far each vertex of a group goes."""
    n, around = group.normals, group.around
    own, following, last = positions[group.corners]
    u, v = following - own, last - own
    pulls = (_dot(n, u + v) / 3 * group.weights)[:, None] * n
    step = around.sums(pulls) / (around.sums(group.weights) / relaxation)[:, None]
    if foldovers == "ignore":
        return step
    areas, slopes = _dot(n, _cross(u, v)), _cross(n, v - u)
    flipped = around.sums((areas < 0).double())
    step = torch.where(flipped[:, None] > 0, step + _tangential_pull(group, positions), step)
    moves, waiting = torch.zeros_like(step), torch.ones_like(flipped, dtype=torch.bool)
    for _ in range(4):
        after = areas + _dot(around.own(step), slopes)
        admitted = waiting & (around.sums((after < 0).double()) <= flipped)
        moves = torch.where(admitted[:, None], step, moves)
        waiting &= ~admitted
        step = 0.5 * step
    return moves


def _tangential_pull(group: _Group, positions: Tensor) -> Tensor:
    """Half the way to the mean of the neighbours, less its part along the mean normal."""
    others = (positions[group.corners] * (group.corners != group.corners[0])[:, :, None]).sum(dim=0)
    pull = group.around.sums(others) / (2 * group.around.counts) - positions[group.vertices]
    normal = group.around.sums(group.normals)
    squared = _dot(normal, normal)[:, None]
    return 0.5 * torch.where(squared > 0, pull - _dot(pull, normal)[:, None] / squared * normal, pull)
