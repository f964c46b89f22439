"""Rotation-invariant features of a face and its surroundings.

The features are the angles between the filtered normals of a face, and their means around it.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.elementary import logf
from cascadenorm.compute.freed_memory import return_freed_memory
from cascadenorm.learned.descriptors import Stack
from cascadenorm.learned.packed_normals import PackedNormals, unpacked
from cascadenorm.mesh import (
    Bools,
    Floats,
    Floats32,
    Ints,
    Ints32,
    Mesh,
    face_area_vectors,
    in_blocks,
    kernel,
    parallel_for,
    row_lengths,
    scatter_add,
)
from cascadenorm.mesh.averages import averaged, averaged_around

Array = NDArray[np.float32]

CONTEXT_STEPS = (0, 1, 3, 7)
"""Numbers of averaging rounds over vertex neighbours after which context features are taken."""
FLOOR = 1e-4
"""Added to 1 - cos before the logarithm. Angles below half a degree count as equal."""
PAIRED_FACES = 128
"""Number of faces whose pairs of normals are compared together. Their normals fit into the L1 cache."""
LEAST_ROWS = 768
"""Number of rows from which BLAS rounds products of the networks alike. It uses other kernels for small matrices."""
TILE = 16
"""Number of faces whose context is transposed together. One row fills a cache line."""


@dataclass(frozen=True, kw_only=True)
class FeatureScaler:
    """Normalisation of the features of a face to mean 0 and deviation 1, and principal directions for its context."""

    pairs: Ints32  # (d, 2) pairs of filtered normals, whose angles are the features x of the face itself
    mean: Array  # (d,) of x, which becomes (x - mean) * scale
    scale: Array  # (d,)
    # (d, p) principal directions of x. The context features are the means of the principal components around the face,
    # and the openness of the mesh. There are none if p is 0.
    projection: Array
    context_mean: Array  # (5 p + 1,) of the context features
    context_scale: Array  # (5 p + 1,)

    def context(self, stack: PackedNormals, mesh: Mesh, sums: "ComponentSums | None" = None) -> "Context":
        """Average the principal components of the features around each vertex, and compute the openness.

        Parameters
        ----------
        stack
            (m, k, 3) filtered normals of all faces of the mesh.
        sums
            Component sums of the larger mesh of which this one is a part. Computed from `mesh` if None.
        """
        if not self.projection.size:
            return Context(mesh.faces, (), np.zeros(len(stack), np.int32), np.empty((1, 0), np.float32))
        components = self._principal(stack)
        sums = sums or component_sums(components, mesh)
        means = averaged_around(components, mesh.topology.vertex_faces)
        freed = components.nbytes
        del components
        return_freed_memory(freed)
        return context_features(means, mesh, sums)

    def sums(self, stack: PackedNormals, mesh: Mesh, among: Bools) -> "ComponentSums":
        """Sum the inputs of the context features over the given faces, (m,) bool, of each component."""
        return component_sums(self._principal(stack[among]), mesh, among)

    def _principal(self, stack: PackedNormals) -> Array:
        """Return the principal components of the features of faces, (m, p)."""
        return in_blocks(len(stack), lambda i, j: (padded(self._own(unpacked(stack[i:j]))) @ self.projection)[: j - i])

    def features(self, stack: Stack, context: Array) -> Array:
        """Return the normalised features of faces: their own, then those of their context.

        Parameters
        ----------
        stack, context
            (m, k, 3) and (m, c) of any faces.

        Returns
        -------
        (m, d + c) features.
        """
        features = np.empty((len(self.mean) + len(self.context_mean), len(stack)), np.float32)
        own, around = np.split(features, [len(self.mean)])
        _write_pairs(stack, self.pairs, self.mean, self.scale, own)
        around[:] = context.T
        _normalize(around, self.context_mean, self.context_scale)
        return features.T

    def _own(self, stack: Stack) -> Array:
        """Return the normalised features of the faces themselves, (m, d)."""
        features = np.empty((len(self.mean), len(stack)), np.float32)
        _write_pairs(stack, self.pairs, self.mean, self.scale, features)
        return features.T


def padded(features: Array) -> Array:
    """Return features, (m, d), with at least LEAST_ROWS rows; the added ones are zero."""
    if len(features) >= LEAST_ROWS:
        return features
    out = np.zeros((features.shape[1], LEAST_ROWS), np.float32)
    out[:, : len(features)] = features.T
    return out.T


def all_pairs(count: int) -> Ints32:
    """Return the pairs i < j of `count` normals, (count (count - 1) / 2, 2), in row order; the array is read-only."""
    pairs = np.stack(np.triu_indices(count, 1), axis=1).astype(np.int32)
    pairs.flags.writeable = False
    return pairs


def pairwise_features(stack: Stack, pairs: Ints32) -> NDArray[np.float32]:
    """Return log(1 - <n_i, n_j> + FLOOR) for pairs of the k normals of a face, which is rotation-invariant.

    Parameters
    ----------
    stack
        (m, k, 3) filtered normals.
    pairs
        (d, 2) pairs of normals.

    Returns
    -------
    (m, d) features.
    """
    out = np.empty((len(pairs), len(stack)), np.float32)
    _write_pairs(stack, pairs, np.zeros(len(out), np.float32), np.ones(len(out), np.float32), out)
    return out.T


def _write_pairs(stack: Stack, pairs: Ints32, mean: Array, scale: Array, out: Array) -> None:
    """Write the normalised pairwise features of faces, (d, m). This layout lets all loops be vectorised."""
    parallel_for(len(stack), _pair_range, by_filter(stack), pairs, mean, scale, out)


def by_filter(stack: Stack) -> Array:
    """Return the filtered normals of faces as (k, 3, m), which is their order in memory after `unpacked`."""
    return np.ascontiguousarray(stack.transpose(1, 2, 0))


class ComponentSums(NamedTuple):
    """Sums over the faces of each of c connected components."""

    faces: Ints  # (c,) numbers of faces
    values: Floats  # (c, p) sums of features
    area_vectors: Floats  # (c, 3)
    areas: Floats  # (c,)


def component_sums(values: NDArray[np.floating[Any]], mesh: Mesh, among: Bools | slice = slice(None)) -> ComponentSums:
    """Sum values over the given faces, (m,) bool, of each component. There is one row of values per given face."""
    component = mesh.topology.face_components
    count = int(component.max(initial=-1)) + 1
    chosen = component[among]
    vectors = face_area_vectors(mesh.vertices, mesh.faces)[among]  # not cached, since the network needs memory
    return ComponentSums(
        np.bincount(chosen, minlength=count),
        scatter_add(chosen, values, count),
        scatter_add(chosen, vectors, count),
        scatter_add(chosen, row_lengths(vectors), count),
    )


class Context(NamedTuple):
    """Context features of the faces of a mesh."""

    faces: Ints32  # (m, 3) faces of the mesh
    averages: tuple[Array, ...]  # (n, p) averages at the vertices, one array per scale
    components: Ints32  # (m,) connected component of each face
    whole: Array  # (c, q) features of the components

    def of(self, rows: slice | NDArray[np.intp] = slice(None)) -> Array:
        """Return the context features of some faces: the averages at their corners and those of their component.

        Returns
        -------
        (r, s p + q) features.
        """
        faces, whole = self.faces[rows], self.whole[self.components[rows]]
        widths = [average.shape[1] for average in self.averages]
        out = np.empty((sum(widths) + whole.shape[1], len(faces)), np.float32)
        start = 0
        for average, width in zip(self.averages, widths, strict=True):
            _write_corner_means(faces, average, out[start : start + width])
            start += width
        out[start:] = whole.T
        return out.T


def context_features(means: Array, mesh: Mesh, sums: ComponentSums) -> Context:
    """Average features around the vertices, over CONTEXT_STEPS rounds, and over the connected component.

    The averages describe the surroundings of a face at several scales, and the overall noise. They are computed between
    vertices, since faces have twice as many rows and neighbours.

    Parameters
    ----------
    means
        (n, p) means at each vertex over its faces.
    sums
        Sums over the components of the mesh, or of the larger mesh of which it is a part.

    Returns
    -------
    The averages after 0, 1, 3 and 7 rounds, in each of which a vertex takes the mean of itself and its neighbours, and
    the means and the openness of the components, (c, p + 1).
    """
    kept, (none, few, *more) = [means], CONTEXT_STEPS
    for rounds in np.diff([none, *more]).tolist():
        kept.append(averaged(kept[-1], mesh.topology.vertex_neighbors, rounds))
    kept.insert(1, averaged(means, mesh.topology.vertex_neighbors, few))  # at the end: one round needs no work array
    whole = np.concatenate([component_means(sums), openness(sums)[:, None]], axis=1, dtype=np.float32)
    return Context(mesh.faces, tuple(kept), mesh.topology.face_components, whole)


def component_means(sums: ComponentSums) -> Floats:
    """Return the mean of the features over each connected component, (c, p)."""
    return np.asarray(sums.values / np.maximum(sums.faces, 1)[:, None])


def openness(sums: ComponentSums) -> Floats:
    """Return the openness of each connected component, |Σ A n| / Σ A.

    A depth camera sees a surface from one side, and its errors resemble the fine detail of a closed surface.

    Returns
    -------
    (c,) from 0 for a closed component to 1 for a flat sheet.
    """
    share = np.linalg.norm(sums.area_vectors, axis=1) / np.maximum(sums.areas, np.finfo(float).tiny)
    return np.asarray(share)


@kernel
def _pair_range(
    start: int, stop: int, normals: Floats32, pairs: Ints32, mean: Floats32, scale: Floats32, out: Floats32
) -> None:
    """Write (ln(1 - cos + FLOOR) - mean) * scale for pairs of normals of each face, (k, 3, m).

    1 - cos is computed as half the squared chord, which is accurate for cos near 1. Iteration f alone writes out[:, f].
    """
    for first in range(start, stop, PAIRED_FACES):
        some, faces = slice(first, min(first + PAIRED_FACES, stop)), min(PAIRED_FACES, stop - first)
        for p in range(len(pairs)):
            i, j, row = pairs[p, 0], pairs[p, 1], out[p, some]
            x0, y0, z0 = normals[i, 0, some], normals[i, 1, some], normals[i, 2, some]
            x1, y1, z1 = normals[j, 0, some], normals[j, 1, some], normals[j, 2, some]
            for f in range(faces):
                x, y, z = x0[f] - x1[f], y0[f] - y1[f], z0[f] - z1[f]
                apart = np.float32(0.5) * (x * x + y * y + z * z) + np.float32(FLOOR)
                row[f] = (logf(apart) - mean[p]) * scale[p]


@kernel
def _normalize(rows: Floats32, mean: Floats32, scale: Floats32) -> None:
    """Compute (rows[i] - mean[i]) * scale[i] in place, in a single pass."""
    for i in range(len(rows)):
        row = rows[i]
        for f in range(len(row)):
            row[f] = (row[f] - mean[i]) * scale[i]


@kernel
def _write_corner_means(faces: Ints32, values: Floats32, out: Floats32) -> None:
    """Write the means over the three corners of each face, (p, m)."""
    third, width = np.float32(1 / 3), values.shape[1]
    means = np.empty((width, TILE), np.float32)
    for first in range(0, len(faces), TILE):
        count = min(TILE, len(faces) - first)
        for f in range(count):
            a, b, c = faces[first + f, 0], faces[first + f, 1], faces[first + f, 2]
            for p in range(width):
                means[p, f] = (values[a, p] + values[b, p] + values[c, p]) * third
        for p in range(width):
            for f in range(count):
                out[p, first + f] = means[p, f]
