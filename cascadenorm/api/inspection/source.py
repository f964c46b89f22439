"""A mesh as given to `inspect`, with the numbering of its source."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm import io
from cascadenorm.io.interop import arrays_of, as_file, is_stored, source_name
from cascadenorm.mesh import Bools, Floats, Ints, Ints32, Mesh, MeshError, first_of_each
from cascadenorm.mesh.mesh import face_array, vertex_array

PLACES = 10  # maximum number of locations that are listed for each finding


@dataclass(frozen=True)
class Found:
    """Number of locations with a defect, and the first of them."""

    count: int  # of faces, vertices or edges
    # up to PLACES numbers of faces or vertices, or pairs of vertices for edges, counted as in the file
    first: tuple[Any, ...]


class GivenMesh(NamedTuple):
    source: str
    number_type: str
    counts_from: int
    vertices: Floats  # (n, 3), not checked
    faces: NDArray[Any]  # (m, 3), not checked
    # vertex_numbers, face_numbers: (n,) and (m,) numbers in the source, counted from 0
    vertex_numbers: Ints
    face_numbers: Ints
    file_vertices: int  # number of positions in the source
    # the mesh of the source, whose connectivity is shared with other inspections; None if the source is not valid
    mesh: Mesh | None

    def at_vertices(self, bad: Bools) -> Found:
        return self._found(self.vertex_numbers[bad])

    def at_faces(self, bad: Bools) -> Found:
        """Locate faces; a polygon that was triangulated counts once and is listed once."""
        return self._found(np.unique(self.face_numbers[bad]))

    def at_edges(self, edges: Ints32) -> Found:
        """Locate edges by the numbers of their vertices."""
        return self._found(self.vertex_numbers[edges])

    def _found(self, places: Ints) -> Found:
        named: Sequence[Any] = (places[:PLACES] + self.counts_from).tolist()
        return Found(len(places), tuple(tuple(place) if isinstance(place, list) else place for place in named))


def taken(mesh: Any, faces: ArrayLike | None) -> GivenMesh:
    """Convert the arguments of `inspect`."""
    if faces is None and (isinstance(mesh, io.MeshFile) or is_stored(mesh)):
        return _given_file(as_file(mesh), source_name(mesh))
    given = mesh if faces is None else (mesh, faces)
    arrays = arrays_of(given)
    kind = np.asarray(arrays[0]).dtype
    vertices, corners = vertex_array(arrays[0]), face_array(arrays[1])
    return GivenMesh(
        source=source_name(given),
        number_type=kind.name if kind.name == "float32" else "float64",
        counts_from=0,
        vertices=vertices,
        faces=corners,
        vertex_numbers=np.arange(len(vertices)),
        face_numbers=np.arange(len(corners)),
        file_vertices=len(vertices),
        mesh=mesh if isinstance(mesh, Mesh) else None,
    )


def _given_file(file: io.MeshFile, name: str) -> GivenMesh:
    mesh: Mesh | None = None
    try:
        mesh = file.mesh
    except MeshError:
        file = file.isolating()
    first = first_of_each(file.welds)
    return GivenMesh(
        source=name,
        number_type=file.positions.dtype.name,
        counts_from=file.counts_from,
        vertices=vertex_array(file.positions[first]),
        faces=np.append(file.welds, np.int32(-1))[file.triangles],
        vertex_numbers=first,
        face_numbers=file.triangle_polygons,
        file_vertices=len(file.positions),
        mesh=mesh,
    )
