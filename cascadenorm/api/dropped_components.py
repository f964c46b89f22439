"""Remove small components from mesh files."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cascadenorm import io
from cascadenorm.geometry.small_components import component_count, small_components
from cascadenorm.io.files import extensible
from cascadenorm.io.interop import mesh_of_file
from cascadenorm.mesh.polygons import Polygons


class Dropped(NamedTuple):
    """A mesh file after its small components were removed, and the numbers of dropped components and polygons.

    `among` is the number of connected components before.
    """

    file: io.MeshFile  # the given file if nothing was dropped, else a PLY or OBJ file in memory
    components: int
    faces: int
    among: int
    left_out: tuple[str, ...]  # other content that the file in memory lacks, in words


def without_small_components(file: io.MeshFile, limit: str | int, name: str) -> Dropped:
    """Drop the components of a file that have fewer faces than a limit of `component_limit`, with their vertices.

    Bad vertices and faces that were isolated are kept. Messages contain the name.
    """
    mesh = mesh_of_file(file, name)
    among = component_count(mesh)
    small, first = small_components(mesh, limit)
    if not len(first):
        return Dropped(file, 0, 0, among, ())
    isolates = bool(file.left_out.any() or file.bad_vertices.any())
    own, lost = extensible(file)
    own = own.isolating() if isolates else own
    small, first = small_components(mesh_of_file(own, name), limit)
    content = own.content()

    # Polygons of small components; polygons that the mesh leaves out belong to no component and are kept
    bad = np.zeros(len(own.polygons), bool)
    bad[own.triangle_polygons[~own.left_out][small]] = True
    outside = own.polygons.out_of_range(len(own.positions))
    kept = ~np.delete(bad, np.unique(own.polygons.owners[outside]))

    # Vertices that only dropped polygons use
    left = content.with_polygons(kept)
    unused = np.zeros(len(content.positions), bool)
    unused[content.with_polygons(~kept).polygons.corners] = True
    unused[left.polygons.corners] = False
    left = replace(
        left,
        positions=content.positions[~unused],
        polygons=Polygons(left.polygons.indptr, (np.cumsum(~unused) - 1)[left.polygons.corners]),
        vertex_values={key: values[~unused] for key, values in content.vertex_values.items()},
    )
    kind = type(own)
    pieces, further = kind.encode(left)
    made = kind(b"".join(pieces), own.folder)
    losses = tuple(dict.fromkeys([*lost, *content.left_out, *further]))
    return Dropped(made.isolating() if isolates else made, len(first), int(bad.sum()), among, losses)
