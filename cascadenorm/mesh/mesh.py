"""A triangle mesh as two contiguous arrays, checked once where it enters."""

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.errors import MeshError
from cascadenorm.mesh.kernels import kernel
from cascadenorm.mesh.threads import parallel_for
from cascadenorm.mesh.topology import Topology
from cascadenorm.messages import counted

Vectors = NDArray[np.float64]
"""(k, 3) float64: positions, normals or displacements."""


class Mesh:
    """n vertices and m triangles; immutable, what is derived from them is computed when first asked for.

    Parameters
    ----------
    vertices : (n, 3) finite numbers, kept as contiguous float64
    faces : (m, 3) integers in 0 … n - 1, m at least 1, kept as contiguous int32

    Raises
    ------
    MeshError : wrong shape or type, a vertex that is not finite, a face that references a vertex that does not exist
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        self.vertices = _checked_vertices(vertices)
        self.faces = _checked_faces(faces, len(self.vertices))
        self.topology = Topology(self.faces, len(self.vertices))

    def moved(self, vertices: Vectors) -> "Mesh":
        """Return the same faces over other positions of the same vertices; the topology is shared."""
        mesh = object.__new__(Mesh)
        mesh.vertices = np.array(vertices, np.float64, order="C")
        if mesh.vertices.shape != self.vertices.shape:
            raise MeshError(f"the vertices have shape {mesh.vertices.shape}; it must stay {self.vertices.shape}")
        mesh.faces, mesh.topology = self.faces, self.topology
        mesh.vertices.flags.writeable = False
        return mesh

    def __reduce__(self) -> tuple[type["Mesh"], tuple[Vectors, NDArray[np.int32]]]:
        """Pickle, and copy, what it is made of, without what was derived from it."""
        return Mesh, (self.vertices, self.faces)

    @property
    def corners(self) -> NDArray[np.float64]:
        """(m, 3, 3) positions of the corners of each face."""
        return self.vertices[self.faces]

    @cached_property
    def centroids(self) -> Vectors:
        """(m, 3) mean of the corners of each face."""
        out = np.empty(self.faces.shape)
        parallel_for(len(out), _centroid_range, self.vertices, self.faces, out)
        return out

    @cached_property
    def area_vectors(self) -> Vectors:
        """(m, 3) normal of each face times its area."""
        out = np.empty(self.faces.shape)
        parallel_for(len(out), _area_vector_range, self.vertices, self.faces, out)
        return out

    @cached_property
    def areas(self) -> NDArray[np.float64]:
        """(m,) area of each face."""
        return np.asarray(np.linalg.norm(self.area_vectors, axis=1))

    @cached_property
    def longest_edges(self) -> NDArray[np.float64]:
        """(m,) length of the longest edge of each face."""
        out = np.empty(len(self.faces))
        parallel_for(len(out), _longest_range, self.vertices, self.faces, out)
        return out

    @cached_property
    def heights(self) -> NDArray[np.float64]:
        """(m,) height of each face over its longest edge; zero where it has no extent."""
        longest = self.longest_edges
        return np.divide(2 * self.areas, longest, out=np.zeros_like(longest), where=longest > 0)

    @cached_property
    def normals(self) -> Vectors:
        """(m, 3) unit normal of each face; zero where the face has no area."""
        return unit(self.area_vectors)

    def sums_around(self, vectors: Vectors) -> Vectors:
        """Add what the faces around each vertex have, one row of (m, 3) a face, to (n, 3)."""
        around = [np.bincount(self.faces.ravel(), np.repeat(column, 3), len(self.vertices)) for column in vectors.T]
        return np.stack(around, axis=1)

    @cached_property
    def vertex_area_vectors(self) -> Vectors:
        """(n, 3) sum of the area vectors around each vertex."""
        return self.sums_around(self.area_vectors)

    @cached_property
    def vertex_normals(self) -> Vectors:
        """(n, 3) unit sum of the area vectors around each vertex; zero where they cancel."""
        return unit(self.vertex_area_vectors)

    @cached_property
    def mean_edge_length(self) -> float:
        """Mean length of the undirected edges; infinite where it is beyond the largest number."""
        vertices, exponent = _near_one(np.where(self.topology.used_vertices[:, None], self.vertices, 0.0))
        lengths = np.empty(len(self.topology.edges))
        parallel_for(len(lengths), _length_range, vertices, self.topology.edges, lengths)
        return _scaled(lengths.mean(), exponent)

    @property
    def area(self) -> float:
        """Total area."""
        return float(self.areas.sum())

    @property
    def volume(self) -> float:
        """Signed enclosed volume; of an open mesh, that of the cone over it from the mean of its used vertices."""
        origin = self.vertices[self.topology.used_vertices].mean(axis=0)
        return float(np.einsum("ij,ij->", self.centroids - origin, self.area_vectors) / 3)

    @cached_property
    def diagonal(self) -> float:
        """Length of the diagonal of the bounding box of used vertices; infinite if beyond the largest number."""
        used = self.vertices[self.topology.used_vertices]
        box, exponent = _near_one(np.stack([used.min(axis=0), used.max(axis=0)]))
        return _scaled(np.linalg.norm(box[1] - box[0]), exponent)


@kernel
def _centroid_range(start, stop, vertices, faces, out):  # type: ignore[no-untyped-def]
    for f in range(start, stop):
        a, b, c = faces[f]
        for d in range(3):
            out[f, d] = (vertices[a, d] + vertices[b, d] + vertices[c, d]) / 3.0


@kernel
def _area_vector_range(start, stop, vertices, faces, out):  # type: ignore[no-untyped-def]
    for f in range(start, stop):
        a, b, c = faces[f]
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        out[f, 0] = 0.5 * (uy * vz - uz * vy)
        out[f, 1] = 0.5 * (uz * vx - ux * vz)
        out[f, 2] = 0.5 * (ux * vy - uy * vx)


@kernel
def _longest_range(start, stop, vertices, faces, out):  # type: ignore[no-untyped-def]
    for f in range(start, stop):
        longest = 0.0
        for k in range(3):
            i, j = faces[f, k - 1], faces[f, k]
            x, y, z = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
            longest = max(longest, x * x + y * y + z * z)
        out[f] = np.sqrt(longest)


@kernel
def _length_range(start, stop, vertices, edges, out):  # type: ignore[no-untyped-def]
    for e in range(start, stop):
        i, j = edges[e]
        x, y, z = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        out[e] = np.sqrt(x * x + y * y + z * z)


def _near_one(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
    """Return values · 2**-exponent, all within -1 … 1, squares of which do not overflow, and the exponent."""
    exponent = int(np.frexp(np.abs(values).max())[1])
    return np.ldexp(values, -exponent), exponent


def _scaled(length: np.floating[Any], exponent: int) -> float:
    with np.errstate(over="ignore"):
        return float(np.ldexp(length, exponent))


def unit(vectors: NDArray[Any], otherwise: NDArray[Any] | None = None) -> Vectors:
    """Scale each row to length 1; rows of length zero become `otherwise`, or stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    scaled = np.divide(vectors, length, out=np.zeros(vectors.shape), where=length > 0)
    return scaled if otherwise is None else np.where(length > 0, scaled, otherwise)


def angles_between(ours: Vectors, theirs: Vectors) -> NDArray[np.float64]:
    """Angles in radians between unit rows that belong together, less those where one is zero; accurate at any angle."""
    proper = ours.any(axis=1) & theirs.any(axis=1)
    ours, theirs = ours[proper], theirs[proper]
    chord, total = np.linalg.norm(ours - theirs, axis=1), np.linalg.norm(ours + theirs, axis=1)
    return np.asarray(2 * np.arctan2(chord, total))


def row_sums(groups: NDArray[Any], values: NDArray[Any]) -> NDArray[np.float64]:
    """Add the rows of values that are of one group, (largest number of a group + 1, columns of values)."""
    out = np.zeros((groups.max(initial=-1) + 1, values.shape[1]))
    _add_rows(groups, values, out)
    return out


@kernel
def _add_rows(groups, values, out):  # type: ignore[no-untyped-def]
    for i in range(len(groups)):
        for p in range(values.shape[1]):
            out[groups[i], p] += values[i, p]


def first_places(bad: NDArray[np.bool_]) -> str:
    """Name the first few true places: '17, 18, 40, …'."""
    places = np.flatnonzero(bad)
    return ", ".join(map(str, places[:3])) + (", …" if len(places) > 3 else "")


def vertex_array(vertices: ArrayLike) -> Vectors:
    """Return vertices as a float64 copy, whatever their values; raises MeshError where they are not (n, 3) numbers."""
    array = np.asarray(vertices)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        raise MeshError(f"vertices have shape {array.shape} and type {array.dtype}; they must be (n, 3) numbers")
    return np.array(array, np.float64, order="C")


def face_array(faces: ArrayLike) -> NDArray[Any]:
    """Return faces as an array, whatever they name; raises MeshError where they are not (m, 3) integers."""
    array = np.asarray(faces)
    if array.size == 0:
        return np.zeros((0, 3), np.int32)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise MeshError(f"faces have shape {array.shape} and type {array.dtype}; they must be (m, 3) integers")
    return array


def _checked_vertices(vertices: ArrayLike) -> Vectors:
    array = vertex_array(vertices)
    bad = np.asarray(~np.isfinite(array).all(axis=1))
    if bad.any():
        raise MeshError(
            f"{bad.sum()} of {len(array)} vertices are not finite (vertices {first_places(bad)})",
            hint="give them a position, remove them and their faces",
            remedy=("on_bad", "isolate"),
        )
    array.flags.writeable = False
    return array


def _checked_faces(faces: ArrayLike, vertex_count: int) -> NDArray[np.int32]:
    array = face_array(faces)
    if not len(array):
        raise MeshError("the mesh has no faces: points alone cannot be denoised here")
    bad = np.asarray(((array < 0) | (array >= vertex_count)).any(axis=1))
    if bad.any():
        which = f"{counted(int(bad.sum()), 'face uses', 'faces use')} vertices that do not exist"
        raise MeshError(
            f"{which} (faces {first_places(bad)}; there are {vertex_count} vertices)",
            hint="drop them, check whether the numbering starts at 0",
            remedy=("on_bad", "isolate"),
        )
    array = np.array(array, np.int32, order="C")
    array.flags.writeable = False
    return array
