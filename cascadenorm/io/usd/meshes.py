"""The meshes that the layers of a USD file define."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.content import CHANNELS, TEXTURE, Content, as_bytes
from cascadenorm.io.shown import NamedValues, reversed_polygons, values_of_vertices
from cascadenorm.mesh.polygons import Polygons

USD_NORMALS = ("primvars:normals", "normals")  # names of attributes with the normals of a mesh


class LayerMesh(NamedTuple):
    layer: str  # its name
    prim: Any  # specification in the layer
    points: NDArray[np.float32]  # (k, 3)
    # Faces. Corners are rows of `points`.
    polygons: Polygons
    # For each corner its index in the file, which has the corners of left-handed meshes in reverse order
    places: NDArray[np.int64]


def meshes_in(name: str, layer: Any) -> Iterator[LayerMesh]:
    """Yield the meshes of a layer with a name. Raises ReadError if one is damaged or its points are animated."""
    paths: list[Any] = []
    layer.Traverse("/", paths.append)
    prims = (layer.GetPrimAtPath(path.GetPrimOrPrimVariantSelectionPath()) for path in paths if path.name == "points")
    for prim in prims:
        if prim is None or prim.typeName not in ("Mesh", ""):
            continue
        points, counts, corners = (value(prim, what) for what in ("points", "faceVertexCounts", "faceVertexIndices"))
        if points is None:
            continue
        if counts is None or corners is None:
            raise ReadError(
                f"{prim.path} has points without faces, which another place defines: "
                "flatten the file (usdcat --flatten)"
            )
        orientation = value(prim, "orientation")
        polygons, places = oriented_polygons(counts, corners, orientation == "leftHanded", str(prim.path))
        if points.ndim != 2 or points.shape[1] != 3 or points.dtype != np.float32:
            raise ReadError(f"the points of {prim.path} are not of type point3f[]: export the file again")
        yield LayerMesh(name, prim, points, polygons, places)


def value(prim: Any, name: str) -> Any:
    """Return an attribute, as an array if possible, or None. Raises ReadError if it has several time samples."""
    attribute = prim.attributes.get(name)
    if attribute is None:
        return None
    times = prim.layer.ListTimeSamplesForPath(attribute.path)
    if len(times) > 1:
        raise ReadError(f"{attribute.path} is animated: export a single frame")
    found = prim.layer.QueryTimeSample(attribute.path, times[0]) if times else attribute.default
    if found is None or isinstance(found, str):
        return found
    try:
        return np.asarray(found)
    except (TypeError, ValueError):
        return None


def set_value(prim: Any, name: str, values: NDArray[Any]) -> None:
    """Replace the value of an attribute that has one."""
    attribute = prim.attributes[name]
    times = prim.layer.ListTimeSamplesForPath(attribute.path)
    stored = prim.layer.QueryTimeSample(attribute.path, times[0]) if times else attribute.default
    kind = np.asarray(stored).dtype
    new = type(stored).FromNumpy(np.ascontiguousarray(values, kind))
    if times:
        prim.layer.SetTimeSample(attribute.path, times[0], new)
    else:
        attribute.default = new


def oriented_polygons(counts: Any, corners: Any, reverses: bool, name: str) -> tuple[Polygons, NDArray[np.int64]]:
    """Return polygons, and the index of each corner in the file. Raises ReadError for damaged polygons."""
    counts, corners = (np.asarray(a) for a in (counts, corners))
    whole = all(a.ndim == 1 and (a.dtype.kind in "iu" or not len(a)) for a in (counts, corners))
    if not whole or (counts < 0).any() or int(counts.sum(dtype=np.int64)) != len(corners):
        raise ReadError(f"the faces of {name} do not fit together: export the file again")
    polygons = Polygons.from_counts(counts.astype(np.int64), corners.astype(np.int64))
    return reversed_polygons(polygons) if reverses else (polygons, np.arange(len(corners)))


def normal_rows(mesh: LayerMesh, name: str) -> tuple[NDArray[Any], NDArray[np.int64]] | None:
    """Return normals with a name, (j, 3), and their row for each corner or -1; None if there are none."""
    try:
        normals, indices = value(mesh.prim, name), value(mesh.prim, f"{name}:indices")
    except ReadError:  # animated normals are not changed
        return None
    if normals is None or normals.ndim != 2 or normals.shape[1] != 3 or normals.dtype.kind != "f":
        return None
    kind = mesh.prim.attributes[name].GetInfo("interpolation") or ("vertex" if name == "normals" else "constant")
    rows = {
        "vertex": mesh.polygons.corners,
        "varying": mesh.polygons.corners,
        "faceVarying": mesh.places,
        "uniform": mesh.polygons.owners,
    }.get(kind)
    if rows is None:
        return None
    if indices is not None and indices.ndim == 1 and indices.dtype.kind in "iu":
        rows = np.append(indices.astype(np.int64), -1)[np.where((rows >= 0) & (rows < len(indices)), rows, -1)]
    return normals, np.where((rows >= 0) & (rows < len(normals)), rows, -1)


def mesh_content(mesh: LayerMesh) -> Content:
    """Return a mesh as its layer defines it, with the values that the layer gives its vertices and faces."""
    values = values_of(_primvars(mesh), len(mesh.points), mesh.polygons, mesh.places)
    return Content(mesh.points, mesh.polygons, *values)


def _primvars(mesh: LayerMesh) -> Iterator[tuple[str, str, Any]]:
    """Yield the name, the interpolation and the values of each primvar of a mesh that is not animated."""
    for attribute in mesh.prim.attributes:
        name = attribute.name.removeprefix("primvars:")
        if name == attribute.name:
            continue
        try:
            values, rows = value(mesh.prim, attribute.name), value(mesh.prim, f"{attribute.name}:indices")
        except ReadError:  # animated
            continue
        if values is not None and rows is not None:
            inside = np.ndim(values) > 0 and rows.dtype.kind in "iu" and ((rows >= 0) & (rows < len(values))).all()
            values = values[rows] if inside else None
        yield name, attribute.GetInfo("interpolation") or "constant", values


def values_of(
    primvars: Iterable[tuple[str, str, Any]], count: int, polygons: Polygons, places: NDArray[np.int64]
) -> tuple[NamedValues, NamedValues]:
    """Return the values of vertices and faces among primvars: colours, texture coordinates, and numbers.

    A primvar is given by its name, its interpolation, and its values without indices.
    """
    vertex_values, face_values = dict[str, NDArray[Any]](), dict[str, NDArray[Any]]()
    for name, kind, flat in primvars:
        values = np.asarray(flat)
        if values.dtype.kind not in "fiub" or not values.ndim:  # among them texts and None
            continue
        if values.dtype in (np.bool_, np.float16):  # other formats do not have these types
            values = values.astype(np.uint8 if values.dtype == np.bool_ else np.float32)
        if kind == "constant" and name == "displayColor" and len(values) == 1:
            kind, values = "vertex", values.repeat(count, axis=0)
        if kind == "faceVarying" and len(values) == len(polygons.corners):
            per_vertex = values_of_vertices(values[places], polygons.corners, count)
            if per_vertex is None:
                continue
            kind, values = "vertex", per_vertex
        if kind in ("vertex", "varying") and len(values) == count:
            vertex_values |= _columns(name, values)
        elif kind == "uniform" and len(values) == len(polygons):
            face_values |= _columns(name, values)
    return vertex_values, face_values


def _columns(name: str, values: NDArray[Any]) -> NamedValues:
    """Return values under the names that PLY uses, or nothing for unsupported vectors."""
    if values.ndim == 1:
        return {name: values}
    if name == "displayColor" and values.shape[1:] == (3,):
        return dict(zip(CHANNELS, as_bytes(values).T, strict=False))
    return dict(zip(TEXTURE, values.T, strict=True)) if name == "st" and values.shape[1:] == (2,) else {}
