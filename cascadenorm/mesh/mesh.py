"""The triangle mesh: two validated, contiguous arrays."""

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm import display
from cascadenorm.compute.arrays import (
    Floats,
    Ints32,
    Vectors,
    as_array,
    box_of,
    first_places,
    row_distances,
    row_lengths,
    unit,
)
from cascadenorm.compute.csr import Csr
from cascadenorm.compute.freed_memory import return_freed_memory
from cascadenorm.compute.kernels import kernel
from cascadenorm.compute.threads import parallel_for
from cascadenorm.errors import MeshError, counted
from cascadenorm.mesh.topology import Topology
from cascadenorm.mesh.vectors import area_vector, row, squared_distance


class Mesh:
    """An immutable triangle mesh with n vertices and m faces; derived quantities are computed on first access.

    Parameters
    ----------
    vertices
        (n, 3) finite numbers, kept as contiguous float64.
    faces
        (m, 3) integers in 0 … n - 1, m at least 1, kept as contiguous int32.

    Raises
    ------
    MeshError
        The arrays have a wrong shape or type, a vertex is not finite, or a face references a missing vertex.
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        self.vertices = _checked_vertices(vertices)
        self.faces = checked_faces(faces, len(self.vertices))
        self.topology = Topology(self.faces, len(self.vertices))

    def moved(self, vertices: Vectors) -> "Mesh":
        """Return the mesh with other vertex positions.

        Parameters
        ----------
        vertices
            (n, 3) finite numbers, which are copied to float64.

        Returns
        -------
        A mesh that shares the faces and the topology.

        Raises
        ------
        MeshError
            The array has another shape.
        """
        mesh = object.__new__(Mesh)
        mesh.vertices = vertex_array(vertices)
        if mesh.vertices.shape != self.vertices.shape:
            raise MeshError(f"the vertices have shape {mesh.vertices.shape}; it must stay {self.vertices.shape}")
        mesh.faces, mesh.topology = self.faces, self.topology
        mesh.vertices.flags.writeable = False
        return mesh

    def forget(self) -> None:
        """Free all cached derived arrays; they are recomputed on the next access."""
        for name in self.__dict__.keys() - {"vertices", "faces", "topology"}:
            self.__dict__.pop(name, None)  # another thread may have freed it
        self.topology.forget()

    def forget_geometry(self) -> None:
        """Free the cached arrays that depend on positions, but neither single numbers nor the topology."""
        freed = 0
        for name in self.__dict__.keys() - {"vertices", "faces"}:
            if isinstance(self.__dict__.get(name), np.ndarray):
                freed += getattr(self.__dict__.pop(name, None), "nbytes", 0)  # another thread may have freed it
        return_freed_memory(freed)

    def with_facts(self, **facts: float) -> "Mesh":
        """Return the mesh with some of its properties replaced by those of a larger mesh that it is a part of.

        Parameters
        ----------
        facts
            Any of `mean_edge_length`, `median_edge_length`, `median_area` and `diagonal`, in units of the vertices.

        Returns
        -------
        A mesh that shares the faces and the topology.
        """
        mesh = self.moved(self.vertices)
        mesh.__dict__.update(facts)
        return mesh

    def __reduce__(self) -> tuple[type["Mesh"], tuple[Vectors, Ints32]]:
        """Pickle and copy the vertices and faces only, without derived arrays."""
        return Mesh, (self.vertices, self.faces)

    def __repr__(self) -> str:
        return f"<cascadenorm.Mesh of {len(self.vertices)} vertices and {len(self.faces)} faces>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the size of the mesh and a picture."""
        return display.described(self)

    @property
    def corners(self) -> Floats:
        """(m, 3, 3) corner positions of each face."""
        return self.vertices[self.faces]

    @cached_property
    def centroids(self) -> Vectors:
        """(m, 3) centroid of each face."""
        out = np.empty(self.faces.shape)
        parallel_for(len(out), _centroid_range, self.vertices, self.faces, out)
        return out

    @cached_property
    def area_vectors(self) -> Vectors:
        """(m, 3) normal of each face times its area."""
        return face_area_vectors(self.vertices, self.faces)

    @cached_property
    def areas(self) -> Floats:
        """(m,) area of each face."""
        return row_lengths(self.area_vectors)

    @cached_property
    def longest_edges(self) -> Floats:
        """(m,) length of the longest edge of each face."""
        out = np.empty(len(self.faces))
        parallel_for(len(out), _longest_range, self.vertices, self.faces, out)
        return out

    @cached_property
    def heights(self) -> Floats:
        """(m,) height of each face above its longest edge; zero for faces without extent."""
        longest = self.longest_edges
        return np.divide(2 * self.areas, longest, out=np.zeros_like(longest), where=longest > 0)

    @cached_property
    def face_normals(self) -> Vectors:
        """(m, 3) unit normal of each face; zero for faces without area."""
        return unit(self.area_vectors)

    def sums_around(self, values: Floats) -> Floats:
        """Sum the values of the faces around each vertex.

        Parameters
        ----------
        values
            (m, …) numbers.

        Returns
        -------
        (n, …) float64; 0 at vertices without a face.
        """
        out = np.empty((len(self.vertices), *values.shape[1:]))
        columns = math.prod(values.shape[1:])
        parallel_for(
            len(out), _sum_around_range, self.topology.vertex_faces,
            np.ascontiguousarray(values, np.float64).reshape(-1, columns), out.reshape(-1, columns),
        )  # fmt: skip
        return out

    @cached_property
    def vertex_area_vectors(self) -> Vectors:
        """(n, 3) sum of the area vectors around each vertex."""
        return self.sums_around(self.area_vectors)

    @cached_property
    def vertex_normals(self) -> Vectors:
        """(n, 3) area-weighted unit normal of each vertex; zero where the area vectors cancel."""
        return unit(self.vertex_area_vectors)

    @cached_property
    def mean_edge_length(self) -> float:
        """Mean length of the undirected edges; infinite on overflow."""
        vertices, exponent = _near_one(np.where(self.topology.used_vertices[:, None], self.vertices, 0.0))
        return _scaled(row_distances(vertices, self.topology.edges).mean(), exponent)

    @cached_property
    def median_edge_length(self) -> float:
        """Median length of the undirected edges."""
        return float(np.median(row_distances(self.vertices, self.topology.edges)))

    @cached_property
    def median_area(self) -> float:
        """Median area of the faces with positive area; 1 if there are none."""
        return float(np.median(self.areas[self.areas > 0])) if self.areas.any() else 1.0

    @property
    def area(self) -> float:
        """Total area."""
        return float(self.areas.sum())

    @property
    def volume(self) -> float:
        """Signed enclosed volume; an open mesh is closed by a cone to the mean of its used vertices."""
        origin = self.vertices[self.topology.used_vertices].mean(axis=0)
        return float(np.einsum("ij,ij->", self.centroids - origin, self.area_vectors) / 3)

    @cached_property
    def box(self) -> tuple[Floats, Floats]:
        """Lower and upper corners, (3,), of the bounding box of the used vertices."""
        used = self.topology.used_vertices
        return box_of(self.vertices if used.all() else self.vertices[used])

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the bounding box of the used vertices; infinite on overflow."""
        box, exponent = _near_one(np.stack(self.box))
        return _scaled(np.linalg.norm(box[1] - box[0]), exponent)


def face_area_vectors(vertices: Vectors, faces: Ints32) -> Vectors:
    """Return the (m, 3) area vectors: the normal of each face times its area."""
    out = np.empty(faces.shape)
    parallel_for(len(out), _area_vector_range, vertices, faces, out)
    return out


@kernel
def _centroid_range(start: int, stop: int, vertices: Vectors, faces: Ints32, out: Vectors) -> None:
    for f in range(start, stop):
        a, b, c = faces[f]
        for d in range(3):
            out[f, d] = (vertices[a, d] + vertices[b, d] + vertices[c, d]) / 3.0


@kernel
def _area_vector_range(start: int, stop: int, vertices: Vectors, faces: Ints32, out: Vectors) -> None:
    for f in range(start, stop):
        a, b, c = row(vertices, faces[f, 0]), row(vertices, faces[f, 1]), row(vertices, faces[f, 2])
        out[f, 0], out[f, 1], out[f, 2] = area_vector(a, b, c)


@kernel
def _sum_around_range(start: int, stop: int, around: Csr, values: Floats, out: Floats) -> None:
    for i in range(start, stop):
        for column in range(values.shape[1]):
            out[i, column] = 0.0
        for k in range(around.indptr[i], around.indptr[i + 1]):
            for column in range(values.shape[1]):
                out[i, column] += values[around.indices[k], column]


@kernel
def _longest_range(start: int, stop: int, vertices: Vectors, faces: Ints32, out: Floats) -> None:
    for f in range(start, stop):
        longest = 0.0
        for k in range(3):
            longest = max(longest, squared_distance(row(vertices, faces[f, k]), row(vertices, faces[f, k - 1])))
        out[f] = np.sqrt(longest)


def _near_one(values: Floats) -> tuple[Floats, int]:
    """Scale values by 2**-exponent into -1 … 1, so that squares do not overflow; also return the exponent."""
    exponent = int(np.frexp(np.abs(values).max())[1])
    return np.ldexp(values, -exponent), exponent


def _scaled(length: np.floating[Any], exponent: int) -> float:
    with np.errstate(over="ignore"):
        return float(np.ldexp(length, exponent))


def vertex_array(vertices: ArrayLike) -> Vectors:
    """Return a float64 copy of the vertices; raise MeshError unless they are (n, 3) numbers, finite or not."""
    array = as_array(
        vertices, MeshError("vertices are a list whose rows have different lengths; they must be (n, 3) numbers")
    )
    if np.ma.is_masked(vertices):
        raise MeshError("vertices have masked coordinates: replace them by NaN, or leave out their faces")
    if array.ndim == 0:
        kind = type(vertices).__name__
        raise MeshError(
            f"vertices are of type {kind}; they must be (n, 3) numbers: pass a mesh or a path without faces"
        )
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        raise MeshError(f"vertices have shape {array.shape} and type {array.dtype}; they must be (n, 3) numbers")
    with np.errstate(invalid="ignore"):  # signalling NaN
        return np.array(array, np.float64, order="C")


def face_array(faces: ArrayLike) -> NDArray[Any]:
    """Return the faces as an array; raise MeshError unless they are (m, 3) integers, in range or not."""
    array = as_array(
        faces, MeshError("faces are a list whose rows have different lengths; they must be (m, 3) integers")
    )
    if np.ma.is_masked(faces):
        raise MeshError("faces have masked indices: leave these faces out")
    if array.size == 0:
        return np.zeros((0, 3), np.int32)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise MeshError(f"faces have shape {array.shape} and type {array.dtype}; they must be (m, 3) integers")
    return array


def _checked_vertices(vertices: ArrayLike) -> Vectors:
    array = vertex_array(vertices)
    if not np.isfinite(array).all():
        bad = np.asarray(~np.isfinite(array).all(axis=1))
        raise MeshError(
            f"{bad.sum()} of {len(array)} vertices are not finite (vertices {first_places(bad)})",
            hint="give them a position, remove them and their faces",
            remedy=("on_bad", "isolate"),
        )
    array.flags.writeable = False
    return array


def checked_faces(faces: ArrayLike, vertex_count: int) -> Ints32:
    """Return a copy of faces as (m, 3) int32; raise MeshError unless there are any, all of vertices that exist."""
    array = face_array(faces)
    if not len(array) and not vertex_count:
        raise MeshError("the mesh has no vertices and no faces: there is nothing to denoise")
    if not len(array):
        raise MeshError("the mesh has no faces: reconstruct a surface from the points first")
    if array.min() < 0 or array.max() >= vertex_count:
        bad = np.asarray(((array < 0) | (array >= vertex_count)).any(axis=1))
        which = f"{counted(int(bad.sum()), 'face uses', 'faces use')} vertices that do not exist"
        raise MeshError(
            f"{which} (faces {first_places(bad)}; there are {vertex_count} vertices)",
            hint="drop them, check whether the numbering starts at 0",
            remedy=("on_bad", "isolate"),
        )
    array = np.array(array, np.int32, order="C")
    array.flags.writeable = False
    return array
