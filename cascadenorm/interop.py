"""Meshes of other libraries: their triangles, and a copy of them with other vertices.

Nothing is imported here: a library whose mesh is handed in has been imported already.
"""

import copy
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import MeshError


class Adapter(NamedTuple):
    """How to take the vertices and triangles out of a foreign mesh, and how to copy it with other vertices."""

    arrays: Callable[[Any], tuple[NDArray[Any], NDArray[Any]]]
    with_vertices: Callable[[Any, NDArray[Any]], Any]


def adapter(mesh: object) -> Adapter:
    """Return the adapter for a mesh object.

    Raises
    ------
    MeshError : a kind of object that is not known
    """
    for kind in type(mesh).__mro__:
        library = kind.__module__.partition(".")[0]
        if (library, kind.__name__) in ADAPTERS:
            return ADAPTERS[library, kind.__name__]
    kind = type(mesh)
    raise MeshError(
        f"{kind.__module__}.{kind.__qualname__} is no kind of mesh that is known here: give vertices and faces as "
        "arrays, a path, a cascadenorm.Mesh, or a mesh of trimesh, pyvista, open3d or meshio"
    )


def _trimesh_arrays(mesh: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _trimesh_moved(mesh: Any, vertices: NDArray[Any]) -> Any:
    moved = mesh.to_mesh() if hasattr(mesh, "to_mesh") else mesh.copy()  # the vertices of a primitive are fixed
    moved.vertices = vertices
    return moved


def _pyvista_arrays(mesh: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    if mesh.n_verts or mesh.n_lines or mesh.n_strips or not mesh.is_all_triangles:
        raise MeshError("the PolyData holds cells that are not triangles: call its triangulate() first")
    return np.asarray(mesh.points), np.asarray(mesh.regular_faces)


def _pyvista_moved(mesh: Any, vertices: NDArray[Any]) -> Any:
    moved = mesh.copy(deep=True)
    moved.points = vertices
    for data, normals in ((moved.point_data, "point_normals"), (moved.cell_data, "cell_normals")):
        if "Normals" in data:
            del data["Normals"]
            data["Normals"] = getattr(moved, normals)
    return moved


def _open3d_arrays(mesh: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


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
        raise MeshError(f"the meshio mesh holds cells of type {', '.join(other)}: only triangles can be denoised")
    blocks = [block.data for block in mesh.cells if block.type == "triangle"]
    return mesh.points, np.concatenate(blocks) if blocks else np.empty((0, 3), np.int64)


def _meshio_moved(mesh: Any, vertices: NDArray[Any]) -> Any:
    moved = copy.deepcopy(mesh)
    moved.points = vertices
    return moved


ADAPTERS = {
    ("trimesh", "Trimesh"): Adapter(_trimesh_arrays, _trimesh_moved),
    ("pyvista", "PolyData"): Adapter(_pyvista_arrays, _pyvista_moved),
    ("open3d", "TriangleMesh"): Adapter(_open3d_arrays, _open3d_moved),
    ("meshio", "Mesh"): Adapter(_meshio_arrays, _meshio_moved),
}
