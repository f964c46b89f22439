"""Remove small components from mesh files."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm import io
from cascadenorm.controls.creases import renumbered_creases
from cascadenorm.controls.weights import mask_weights, selected_faces, selected_vertices
from cascadenorm.errors import ParameterError
from cascadenorm.geometry.small_components import component_count, small_components
from cascadenorm.io.files import as_one_mesh
from cascadenorm.io.gltf.gltf import GltfFile
from cascadenorm.io.interop import mesh_of_file
from cascadenorm.io.obj import ObjFile
from cascadenorm.mesh import marked
from cascadenorm.mesh.polygons import Polygons
from cascadenorm.registry.controls import Controls


class Dropped(NamedTuple):
    """A mesh file after its small components were removed, and the numbers of dropped components and triangles.

    `among` is the number of connected components before; None if none were to be dropped.
    """

    file: io.MeshFile  # the given file if nothing was dropped, else a PLY, OBJ or glTF file in memory
    components: int = 0
    faces: int = 0
    among: int | None = None
    left_out: tuple[str, ...] = ()  # other content that the file in memory lacks, in words
    # (m,) faces of the mesh of the given file that are kept; None if all are, or if they are unknown
    kept: NDArray[np.bool_] | None = None


def without_small_components(file: io.MeshFile, limit: str | int, name: str) -> Dropped:
    """Drop the components of a file that have fewer faces than a limit of `component_limit`, with their vertices.

    Bad vertices and faces that were isolated are kept. Messages contain the name.
    """
    mesh = mesh_of_file(file, name, may_isolate=True)
    among = component_count(mesh)
    small, first = small_components(mesh, limit)
    if not len(first):
        return Dropped(file, among=among)
    if isinstance(file, GltfFile):
        gone = marked(file.triangle_polygons[~file.left_out][small], len(file.polygons))
        if (rest := file.without(gone)) is not None:
            in_place = file.parts is None or np.array_equal(file.content().positions, file.positions, equal_nan=True)
            rest = rest.with_settings_of(file)
            return Dropped(rest, len(first), int(small.sum()), among, (), ~small if in_place else None)
    own, lost = as_one_mesh(file)
    own = own if own is file else own.with_settings_of(file)
    shown = mesh_of_file(own, name)  # the scene may show a mesh several times
    same_order = file.parts is None or np.array_equal(own.positions, file.positions, equal_nan=True)
    matches = same_order and len(shown.faces) == len(mesh.faces)
    among = component_count(shown)
    small, first = small_components(shown, limit)
    if not len(first):
        return Dropped(file, among=among)
    content = own.content()

    # Polygons of small components; polygons that the mesh leaves out belong to no component and are kept
    bad = marked(own.triangle_polygons[~own.left_out][small], len(own.polygons))
    outside = own.polygons.out_of_range(len(own.positions))
    kept = ~np.delete(bad, np.unique(own.polygons.owners[outside]))

    # Vertices that only dropped polygons use
    left = content.with_polygons(kept)
    unused = marked(content.with_polygons(~kept).polygons.corners, len(content.positions))
    unused[left.polygons.corners] = False
    made: io.MeshFile | None = own.without(bad, unused) if isinstance(own, ObjFile) else None
    if made is None:
        kind = type(own)
        pieces, further = kind.encode(
            replace(
                left,
                positions=content.positions[~unused],
                polygons=Polygons(left.polygons.indptr, (np.cumsum(~unused) - 1)[left.polygons.corners]),
                vertex_values={key: values[~unused] for key, values in content.vertex_values.items()},
            )
        )
        made, lost = kind(b"".join(pieces), own.folder), [*lost, *content.left_out, *further]
    made = made.with_settings_of(file)
    left_out = tuple(dict.fromkeys(lost))
    return Dropped(made, len(first), int(small.sum()), among, left_out, ~small if matches else None)


def controls_of_kept(controls: Controls, dropped: Dropped, before: io.MeshFile) -> Controls:
    """Return controls over the mesh of a file as controls over its components that were kept.

    Raises ParameterError for a mask or fixed vertices that do not fit the mesh of the file, and if the two meshes do
    not correspond, since a scene moves, repeats or omits meshes.
    """
    mask, fixed, only, creases = (controls[name] for name in ("mask", "fixed", "only", "creases"))
    if not dropped.components or (mask is None and fixed is None and only is None and np.asarray(creases).ndim < 2):
        return controls
    mesh, faces, found = before.mesh, dropped.file.mesh.faces, controls.copy()
    source = np.full(len(dropped.file.mesh.vertices), -1)  # the vertex of the file that each vertex is
    if dropped.kept is not None:
        source[faces] = mesh.faces[dropped.kept]
    if dropped.kept is None or not np.array_equal(source[faces], mesh.faces[dropped.kept]):
        raise ParameterError(
            "cannot be combined with mask, fixed, only or creases in this file, because its scene moves, repeats or "
            "omits meshes",
            parameter="drop_components",
            hint="write the file as PLY first",
        )
    if mask is not None:
        found["mask"] = mask_weights(mask, len(mesh.vertices))[source]
    if fixed is not None:
        found["fixed"] = selected_vertices("fixed", fixed, len(mesh.vertices))[source]
    if only is not None:
        found["only"] = selected_faces(only, len(mesh.faces))[dropped.kept]
    numbers = np.full(len(mesh.vertices), -1)
    numbers[mesh.faces[dropped.kept]] = faces
    found["creases"] = renumbered_creases(creases, numbers)
    return found
