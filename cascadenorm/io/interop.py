"""Conversion of files and of meshes of libraries, which are not imported here, and copies with moved vertices."""

import copy
from collections.abc import Callable
from functools import partial
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm import io
from cascadenorm.io import polydata, vtk
from cascadenorm.io.files import stream_name
from cascadenorm.mesh import Mesh, MeshError
from cascadenorm.mesh.normals import Normals, renewed_normals
from cascadenorm.mesh.welding import weld


class Adapter(NamedTuple):
    """Functions that extract vertices and triangles from a third-party mesh, and copy it with other vertices."""

    arrays: Callable[[Any], tuple[NDArray[Any], NDArray[Any]]]
    with_vertices: Callable[[Any, NDArray[Any]], Any]


def adapter(mesh: object) -> Adapter:
    """Return the adapter for a mesh object. Raises MeshError if the kind of object is unknown."""
    hint = "pass (vertices, faces), a path, a cascadenorm.Mesh, or a mesh of trimesh, pyvista, vtk, open3d or meshio"
    for kind in type(mesh).__mro__:
        key = _key(kind)
        if key[0] == "open3d" and "t" in kind.__module__.split("."):
            raise MeshError("tensor meshes of open3d are not supported: pass mesh.to_legacy()")
        if key in ADAPTERS:
            return ADAPTERS[key]
        if key in CONVERSIONS:
            hint = f"pass {CONVERSIONS[key]}"
            break
    kind = type(mesh)
    raise MeshError(f"{kind.__module__}.{kind.__qualname__} is not a supported kind of mesh", hint=hint)


def _key(kind: type) -> tuple[str, str]:
    """Return the library and the name of a class, as in ADAPTERS and CONVERSIONS."""
    return kind.__module__.partition(".")[0], kind.__name__


def as_mesh(source: Any) -> Mesh:
    """Return the triangles of a mesh of any kind. All public functions use this conversion.

    Parameters
    ----------
    source
        A `Mesh`; a pair of arrays, vertices (n, 3) and faces (m, 3); a mesh of trimesh, pyvista, vtk, open3d or meshio;
        a file that `read` returned; the path of a file; or a stream of its bytes.

    Raises
    ------
    MeshError
        The source is not a valid mesh. The subclass ReadError is raised if a file cannot be read.
    """
    if isinstance(source, Mesh):
        return source
    if isinstance(source, io.MeshFile) or is_stored(source):
        return mesh_of_file(as_file(source), source_name(source))
    try:
        return Mesh(*arrays_of(source))
    except MeshError as error:
        error.remedy = None  # as in `mesh_of_file`
        raise


def as_file(source: Any) -> io.MeshFile:
    """Return a mesh of any kind that `as_mesh` accepts as a file that can be written."""
    if isinstance(source, io.MeshFile):
        return source
    return io.read(source) if is_stored(source) else io.from_arrays(*arrays_of(source))


def arrays_of(mesh: Any) -> tuple[ArrayLike, ArrayLike]:
    """Return vertices and faces, unchecked, of a `Mesh`, a pair of arrays or a third-party mesh."""
    if isinstance(mesh, Mesh):
        return mesh.vertices, mesh.faces
    if is_pair(mesh):
        vertices, faces = mesh
        return vertices, faces
    return adapter(mesh).arrays(mesh)


def is_pair(mesh: object) -> bool:
    """Whether a mesh is given as a pair of arrays, (vertices, faces)."""
    return isinstance(mesh, tuple | list) and len(mesh) == 2


def save_mesh(path: Path, mesh: Mesh, *, force: bool = False) -> None:
    """Write triangles to a new file in the format of its extension."""
    io.write(io.from_arrays(mesh.vertices, mesh.faces), path, force=force)


def mesh_of_file(file: io.MeshFile, name: str, *, may_isolate: bool = False) -> Mesh:
    """Return the triangles of a file that was read. Error messages start with its name.

    They suggest to isolate what is bad only if the caller can do so.
    """
    try:
        return file.mesh
    except io.ReadError:
        raise
    except MeshError as error:
        error.remedy = error.remedy if may_isolate else None
        raise error.within(name) from None


def is_stored(source: object) -> bool:
    """Whether a mesh is given as the path of a file or as a stream of its bytes."""
    if isinstance(source, str | PathLike):
        return True
    known = any(_key(kind) in ADAPTERS for kind in type(source).__mro__)
    return hasattr(source, "read") and not known  # the class of meshio meshes has a method `read`, too


def source_name(source: Any) -> str:
    """Return the name of a file or a stream for messages, and for other meshes what kind they are."""
    if is_stored(source):
        return fspath(source) if isinstance(source, str | PathLike) else stream_name(source)
    if isinstance(source, io.MeshFile):
        return f"the {source.format} file"
    return "arrays" if is_pair(source) else type(source).__name__


def _trimesh_moved(mesh: Any, vertices: NDArray[Any]) -> Any:
    if hasattr(mesh, "to_mesh"):  # the vertices of a primitive cannot be changed
        kept = ("metadata", "vertex_attributes", "face_attributes")
        others = {name: copy.deepcopy(getattr(mesh, name)) for name in kept}
        moved = mesh.to_mesh(visual=mesh.visual.copy(), **others)
    else:
        moved = mesh.copy()
    moved.vertices = vertices
    return moved


def _vtk_arrays(mesh: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    polygons = mesh.GetPolys()
    if mesh.GetNumberOfStrips() or polygons.IsHomogeneous() not in (0, 3):  # 0 without polygons
        name, hint = "vtkPolyData", "apply vtkTriangleFilter to it, in ParaView Triangulate"
        if hasattr(mesh, "triangulate"):
            name, hint = "PolyData", "call its triangulate() first"
        raise MeshError(f"the {name} has cells that are not triangles", hint=hint)
    points = polydata.vtk_array(mesh.GetPoints().GetData()) if mesh.GetNumberOfPoints() else np.empty((0, 3))
    return points, polydata.vtk_array(polygons.GetConnectivityArray()).reshape(-1, 3)


def _vtk_moved(mesh: Any, vertices: NDArray[Any]) -> Any:
    if hasattr(mesh, "triangulate"):  # of pyvista
        moved = mesh.copy(deep=True)
    else:
        moved = mesh.NewInstance()
        moved.DeepCopy(mesh)
    points, triangles = _vtk_arrays(mesh)
    renew = partial(_renewed, points, triangles, vertices)
    polydata.move_polydata(moved, vertices, triangles, np.arange(len(triangles)), renew)
    return moved


def _renewed(
    points: NDArray[Any], triangles: NDArray[Any], vertices: NDArray[Any], values: NDArray[Any], corners: NDArray[Any]
) -> NDArray[np.float64]:
    """Return recomputed normals for triangles that have moved from `points` to `vertices`."""
    faces = triangles.astype(np.int64)
    welds, _ = weld(points, faces)
    normals, _ = renewed_normals(Normals(values, corners.astype(np.int64)), faces, welds, points, vertices)
    return normals


def _open3d_moved(mesh: Any, vertices: NDArray[Any]) -> Any:
    moved = copy.deepcopy(mesh)
    moved.vertices = type(mesh.vertices)(vertices)
    if mesh.has_vertex_normals():
        moved.compute_vertex_normals()
    elif mesh.has_triangle_normals():
        moved.compute_triangle_normals()
    return moved


def _meshio_arrays(mesh: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    other = sorted({block.type for block in mesh.cells} - {"triangle", "line", "vertex"})
    if other:
        raise MeshError(f"the meshio mesh has cells of type {', '.join(other)}: only triangles can be denoised")
    blocks = [block.data for block in mesh.cells if block.type == "triangle"]
    return mesh.points, np.concatenate(blocks) if blocks else np.empty((0, 3), np.int64)


def _meshio_moved(mesh: Any, vertices: NDArray[Any]) -> Any:
    moved = copy.deepcopy(mesh)
    points, triangles = _meshio_arrays(mesh)
    renew = partial(_renewed, points, triangles, vertices)
    vtk.move_grid(moved, vertices, triangles, np.arange(len(triangles)), renew)
    if all(name in moved.point_data for name in ("nx", "ny", "nz")):  # names as in PLY
        stored = np.stack([moved.point_data[name] for name in ("nx", "ny", "nz")], axis=1)
        moved.point_data.update(zip(("nx", "ny", "nz"), renew(stored, triangles).astype(stored.dtype).T, strict=True))
    return moved


ADAPTERS = {
    ("trimesh", "Trimesh"): Adapter(lambda mesh: (np.asarray(mesh.vertices), np.asarray(mesh.faces)), _trimesh_moved),
    ("pyvista", "PolyData"): Adapter(_vtk_arrays, _vtk_moved),
    ("vtkmodules", "vtkPolyData"): Adapter(_vtk_arrays, _vtk_moved),
    ("open3d", "TriangleMesh"): Adapter(
        lambda mesh: (np.asarray(mesh.vertices), np.asarray(mesh.triangles)), _open3d_moved
    ),
    ("meshio", "Mesh"): Adapter(_meshio_arrays, _meshio_moved),
}

OR_BLOCKS = "or denoise its blocks, by denoise_regions if they share walls"
CONVERSIONS = {
    ("numpy", "ndarray"): "the faces too: (vertices, faces)",
    ("builtins", "list"): "the faces too: (vertices, faces)",
    ("trimesh", "Scene"): "scene.to_mesh()",
    ("pyvista", "UnstructuredGrid"): "its surface, grid.extract_surface().triangulate()",
    ("vtkmodules", "vtkUnstructuredGrid"): "its surface, by vtkGeometryFilter and vtkTriangleFilter",
    ("pyvista", "MultiBlock"): f"its surface, blocks.combine().extract_surface().triangulate(), {OR_BLOCKS}",
    ("vtkmodules", "vtkCompositeDataSet"): "its surface, by vtkCompositeDataGeometryFilter and vtkTriangleFilter, "
    + OR_BLOCKS,
}
"""How to convert other objects to a mesh, in words."""
