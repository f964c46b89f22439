"""Read the surface of a Blender object as arrays, and write new positions."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import MeshError, ParameterError
from cascadenorm.mesh import marked
from cascadenorm.mesh.normals import Normals, renewed_normals

RESULT = "Denoised"  # name of the shape key that holds a result


class Surface(NamedTuple):
    """The triangles of an object."""

    positions: NDArray[np.float32]  # (n, 3) float32, as stored by Blender
    faces: NDArray[np.int32]  # (m, 3) vertex indices of polygons triangulated as Blender draws them
    scale: NDArray[np.float64]  # (3,) scale of the object along its axes

    @property
    def vertices(self) -> NDArray[Any]:
        """Positions in scene units; float32 if the object is not scaled."""
        return self.positions if (self.scale == 1).all() else self.positions * self.scale

    def positions_of(self, vertices: NDArray[Any]) -> NDArray[np.float32]:
        """Return the positions of new vertices; those of unmoved vertices are bit-identical."""
        with np.errstate(divide="ignore", invalid="ignore"):
            unscaled = vertices / self.scale
        return np.where(vertices == self.vertices, self.positions, unscaled).astype(np.float32)


def surface_of(object: Any) -> Surface:
    """Return the surface of an object, of its active shape key, or of the original of a denoised copy."""
    mesh = object.data
    object.update_from_editmode()
    mesh.calc_loop_triangles()
    positions = _array(_given(object), "co", np.float32, 3)
    if len(positions) != len(mesh.vertices):
        raise MeshError(
            f"{object.name} has {len(mesh.vertices)} vertices, but {object.cascadenorm.source.name}, its original, has "
            f"{len(positions)}: make a new copy"
        )
    scale = np.abs(np.array(object.matrix_world.to_scale(), np.float64))
    return Surface(positions, _array(mesh.loop_triangles, "vertices", np.int32, 3), np.where(scale == 0, 1, scale))


def mask_of(object: Any, settings: Any) -> NDArray[np.float32] | None:
    """Return weights of the vertex group and the selection; None moves all. Raises ParameterError if empty."""
    mesh, mask = object.data, None
    if name := settings.vertex_group:
        if name not in object.vertex_groups:
            raise ParameterError(f"is {name!r}, which is not a vertex group of {object.name}", parameter="mask")
        index = object.vertex_groups[name].index
        weights = [next((g.weight for g in v.groups if g.group == index), 0.0) for v in mesh.vertices]
        mask = np.clip(np.array(weights, np.float32), 0, 1)
        mask = 1 - mask if settings.invert_vertex_group else mask
    if object.mode == "EDIT":
        selected = _array(mesh.vertices, "select", bool)
        if not selected.any():
            raise ParameterError("no vertex is selected; Edit Mode denoises only selected vertices", hint="select some")
        mask = selected.astype(np.float32) if mask is None else mask * selected
    return mask


def creases_of(object: Any, settings: Any) -> float | NDArray[np.int32] | None:
    """Return the chosen creases: an angle in degrees, or the vertices of marked edges."""
    mesh = object.data
    if settings.creases == "NONE":
        return None
    if settings.creases == "ANGLE":
        return float(str(np.float32(np.degrees(settings.crease_angle))))
    creases = np.zeros(len(mesh.edges), bool)
    if "SHARP" in settings.creases:
        creases |= _array(mesh.edges, "use_edge_sharp", bool)
    if "SEAM" in settings.creases:
        creases |= _array(mesh.edges, "use_seam", bool)
    of_faces = marked(_array(mesh.loops, "edge_index", np.int32), len(mesh.edges))
    return _array(mesh.edges, "vertices", np.int32, 2)[creases & of_faces]


def write_positions(object: Any, positions: NDArray[np.float32]) -> None:
    """Move the vertices of an object in Object mode, or its active shape key and those relative to it."""
    mesh, key = object.data, object.active_shape_key
    if key is not None:
        moved = positions - _array(key.data, "co", np.float32, 3)
        for other in mesh.shape_keys.key_blocks:
            if other != key and other.relative_key == key:
                other.data.foreach_set("co", (_array(other.data, "co", np.float32, 3) + moved).ravel())
        key.data.foreach_set("co", positions.ravel())
    if key is None or key == mesh.shape_keys.reference_key:
        _renew_free_normals(mesh, positions)
        mesh.vertices.foreach_set("co", positions.ravel())
    mesh.update()


def write_shape_key(object: Any, positions: NDArray[np.float32]) -> None:
    """Write positions into the shape key for results, with value 1; the object is in Object mode."""
    if object.data.shape_keys is None:
        object.shape_key_add(name="Basis", from_mix=False)
    blocks = object.data.shape_keys.key_blocks
    base = object.active_shape_key
    if RESULT not in blocks:
        object.shape_key_add(name=RESULT, from_mix=False).relative_key = base
    blocks[RESULT].data.foreach_set("co", positions.ravel())
    blocks[RESULT].value = 1.0
    object.data.update()


def copy_of(object: Any) -> Any:
    """Return a selected copy of an object that refers to it as its original, and hide the object."""
    copy = object.copy()
    copy.data = object.data.copy()
    copy.name = copy.data.name = f"{object.name} denoised"
    copy.cascadenorm.source = object
    for collection in object.users_collection:
        collection.objects.link(copy)
    object.hide_set(True)
    copy.select_set(True)
    return copy


def _renew_free_normals(mesh: Any, positions: NDArray[np.float32]) -> None:
    """Recompute normals that are stored as vectors; others are relative to the surface and move with it."""
    attribute = mesh.attributes.get("custom_normal")
    if attribute is None or attribute.data_type != "FLOAT_VECTOR":
        return
    mesh.calc_loop_triangles()
    faces, triangles = _array(mesh.loop_triangles, "vertices", np.int32, 3), mesh.loop_triangles
    corners = {
        "POINT": lambda: faces,
        "CORNER": lambda: _array(triangles, "loops", np.int32, 3),
        "FACE": lambda: np.repeat(_array(triangles, "polygon_index", np.int32)[:, None], 3, axis=1),
    }[attribute.domain]()
    normals = Normals(_array(attribute.data, "vector", np.float32, 3), corners.astype(np.int64))
    before, each = _array(mesh.vertices, "co", np.float32, 3), np.arange(len(positions), dtype=np.int32)
    renewed, _ = renewed_normals(normals, faces.astype(np.int64), each, before, positions)
    attribute.data.foreach_set("vector", renewed.astype(np.float32).ravel())


def _given(object: Any) -> Any:
    """Return the elements that hold the positions to denoise, with a coordinate `co`."""
    if source := object.cascadenorm.source:
        object = source
    key = object.active_shape_key
    if key is None:
        return object.data.vertices
    return (key.relative_key if key.name == RESULT else key).data


def _array(elements: Any, name: str, kind: Any, width: int = 1) -> NDArray[Any]:
    """Return an attribute of the elements of a Blender collection, (k, width), or (k,) if the width is 1."""
    flat = np.empty(len(elements) * width, kind)
    elements.foreach_get(name, flat)
    return flat if width == 1 else flat.reshape(-1, width)
