"""Check which attributes of meshes of other libraries are kept by denoising.

    python -m benchmarks.robustness.round_trips [--record]

Needs all of these libraries. The table is that of docs/other-programs.md.
"""

import argparse
import importlib
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

import cascadenorm as cn
from benchmarks import results

SPHERE = trimesh.creation.icosphere(subdivisions=2)
NOISE = 0.02 * np.random.default_rng(0).normal(size=SPHERE.vertices.shape)
VERTICES, FACES = SPHERE.vertices + NOISE, np.asarray(SPHERE.faces)
N, M = len(VERTICES), len(FACES)
RNG = np.random.default_rng(1)
COLORS, FACE_COLORS = RNG.integers(0, 256, (N, 4), np.uint8), RNG.integers(0, 256, (M, 4), np.uint8)
VALUES, FACE_VALUES, UV = RNG.random(N), RNG.random(M), RNG.random((N, 2))


class Case(NamedTuple):
    """A mesh with attributes.

    Parameters
    ----------
    mesh
        As the library has it, or a pair of arrays.
    attributes
        By name, a function that reads each, as something that `numpy.testing` compares.
    normals
        By name, a function that reads each.
    vertices
        A function that reads the vertices.
    """

    mesh: Any
    attributes: dict[str, Callable[[Any], Any]]
    normals: dict[str, Callable[[Any], Any]]
    vertices: Callable[[Any], Any]


def of_trimesh() -> list[Case]:
    """Return a mesh with colours and one with a texture."""
    visual = {"vertex_colors": COLORS, "face_colors": None}
    colored = trimesh.Trimesh(VERTICES, FACES, process=False, metadata={"unit": "mm"}, **visual)
    colored.vertex_attributes["value"], colored.face_attributes["value"] = VALUES, FACE_VALUES
    material = trimesh.visual.material.SimpleMaterial(diffuse=[10, 20, 30, 255])
    textured = trimesh.Trimesh(
        VERTICES, FACES, process=False, visual=trimesh.visual.TextureVisuals(uv=UV, material=material)
    )
    painted = trimesh.Trimesh(VERTICES, FACES, process=False, face_colors=FACE_COLORS)
    own = {
        "vertex attributes": lambda mesh: mesh.vertex_attributes["value"],
        "face attributes": lambda mesh: mesh.face_attributes["value"],
        "vertex colours": lambda mesh: mesh.visual.vertex_colors,
        "metadata": lambda mesh: mesh.metadata["unit"],
    }
    texture = {
        "texture coordinates": lambda mesh: mesh.visual.uv,
        "material": lambda mesh: mesh.visual.material.diffuse,
    }
    normals = {"vertex normals": lambda mesh: mesh.vertex_normals, "face normals": lambda mesh: mesh.face_normals}
    return [
        Case(colored, own, normals, lambda mesh: mesh.vertices),
        Case(textured, texture, {}, lambda mesh: mesh.vertices),
        Case(painted, {"face colours": lambda mesh: mesh.visual.face_colors}, {}, lambda mesh: mesh.vertices),
    ]


def of_pyvista() -> list[Case]:
    """Return a PolyData with arrays of every kind."""
    mesh = importlib.import_module("pyvista").PolyData.from_regular_faces(VERTICES, FACES)
    mesh.point_data["value"], mesh.cell_data["value"], mesh.field_data["unit"] = VALUES, FACE_VALUES, ["mm"]
    mesh.point_data["rgba"] = COLORS
    mesh.active_texture_coordinates = UV
    normals = cn.Mesh(VERTICES, FACES)
    mesh.point_data["Normals"], mesh.cell_data["Normals"] = normals.vertex_normals, normals.face_normals
    attributes = {
        "point data": lambda mesh: mesh.point_data["value"],
        "cell data": lambda mesh: mesh.cell_data["value"],
        "field data": lambda mesh: list(mesh.field_data["unit"]),
        "colours": lambda mesh: mesh.point_data["rgba"],
        "active texture coordinates": lambda mesh: mesh.active_texture_coordinates,
    }
    stored = {
        "point normals": lambda mesh: mesh.point_data["Normals"],
        "cell normals": lambda mesh: mesh.cell_data["Normals"],
    }
    return [Case(mesh, attributes, stored, lambda mesh: mesh.points)]


def of_open3d() -> list[Case]:
    """Return a TriangleMesh with colours, normals and a texture."""
    open3d = importlib.import_module("open3d")
    vectors = open3d.utility.Vector3dVector
    mesh = open3d.geometry.TriangleMesh(vectors(VERTICES), open3d.utility.Vector3iVector(FACES))
    mesh.vertex_colors = vectors(COLORS[:, :3] / 255)
    mesh.triangle_uvs = open3d.utility.Vector2dVector(RNG.random((3 * M, 2)))
    mesh.triangle_material_ids = open3d.utility.IntVector(RNG.integers(0, 3, M, np.int32))
    mesh.textures = [open3d.geometry.Image(np.ascontiguousarray(FACE_COLORS[:64, :3]).reshape(8, 8, 3))]
    mesh.compute_adjacency_list()
    mesh.compute_vertex_normals()
    attributes = {
        "vertex colours": lambda mesh: np.asarray(mesh.vertex_colors),
        "texture coordinates of triangles": lambda mesh: np.asarray(mesh.triangle_uvs),
        "material of triangles": lambda mesh: np.asarray(mesh.triangle_material_ids),
        "textures": lambda mesh: [np.asarray(image) for image in mesh.textures],
        "adjacency list": lambda mesh: [sorted(near) for near in mesh.adjacency_list],
    }
    normals = {
        "vertex normals": lambda mesh: np.asarray(mesh.vertex_normals),
        "triangle normals": lambda mesh: np.asarray(mesh.triangle_normals),
    }
    return [Case(mesh, attributes, normals, lambda mesh: np.asarray(mesh.vertices))]


def of_meshio() -> list[Case]:
    """Return a mesh with data, sets, and cells other than triangles."""
    meshio = importlib.import_module("meshio")
    shape = cn.Mesh(VERTICES, FACES)
    mesh = meshio.Mesh(
        VERTICES,
        [("triangle", FACES), ("line", [[0, 1], [1, 2]])],
        point_data={"value": VALUES, "Normals": shape.vertex_normals},
        cell_data={"value": [FACE_VALUES, np.zeros(2)], "Normals": [shape.face_normals, np.zeros((2, 3))]},
        field_data={"steel": np.array([1, 2])},
        point_sets={"left": [0, 1, 2]},
        cell_sets={"upper": [np.array([0, 1]), np.array([], int)]},
    )
    attributes = {
        "point data": lambda mesh: mesh.point_data["value"],
        "cell data": lambda mesh: mesh.cell_data["value"],
        "field data": lambda mesh: mesh.field_data["steel"],
        "point sets": lambda mesh: mesh.point_sets["left"],
        "cell sets": lambda mesh: mesh.cell_sets["upper"],
        "lines and vertices": lambda mesh: mesh.cells_dict["line"],
    }
    normals = {
        "point data `Normals`": lambda mesh: mesh.point_data["Normals"],
        "cell data `Normals`": lambda mesh: mesh.cell_data["Normals"][0],
    }
    return [Case(mesh, attributes, normals, lambda mesh: mesh.points)]


def of_arrays() -> list[Case]:
    """Return vertices and faces in the form that libigl, potpourri3d and PyMeshLab use."""
    kinds = {
        "float32": (VERTICES.astype(np.float32), FACES),
        "rows that are not contiguous (libigl)": (np.asfortranarray(VERTICES), np.asfortranarray(FACES)),
        "read-only arrays": (_locked(VERTICES), _locked(FACES)),
        "faces as uint32 or int32": (VERTICES, FACES.astype(np.uint32)),
    }
    return [
        Case(arrays, {name: lambda given: (given[0].dtype.str, given[1].dtype.str, given[0].shape)}, {}, lambda a: a[0])
        for name, arrays in kinds.items()
    ]


def _locked(array: NDArray[Any]) -> NDArray[Any]:
    locked = array.copy()
    locked.flags.writeable = False
    return locked


LIBRARIES = {
    "trimesh": of_trimesh,
    "pyvista": of_pyvista,
    "open3d": of_open3d,
    "meshio": of_meshio,
    "arrays": of_arrays,
}


def row(cases: list[Case]) -> tuple[list[str], list[str], list[str]]:
    """Denoise each mesh; return the names of the attributes that are kept, recomputed and lost."""
    kept, renewed, lost = [], [], []
    for case in cases:
        if isinstance(case.mesh, tuple):
            after = (cn.denoise(*case.mesh, method="bilateral-normal"), case.mesh[1])
        else:
            after = cn.denoise(case.mesh, method="bilateral-normal")
            assert type(after) is type(case.mesh)
        moved = cn.Mesh(np.asarray(case.vertices(after), float), FACES)
        assert (moved.vertices != np.asarray(case.vertices(case.mesh), float)).any()
        for name, read in case.attributes.items():
            (kept if _same(read, case.mesh, after) else lost).append(name)
        for name, read in case.normals.items():
            values = np.asarray(read(after))
            true = moved.face_normals if len(values) == M else moved.vertex_normals
            near = len(values) == len(true) and np.einsum("ij,ij->i", values, true).min() > 0.99
            (renewed if near and not _same(read, case.mesh, after) else lost).append(name)
    return kept, renewed, lost


def _same(read: Callable[[Any], Any], before: Any, after: Any) -> bool:
    try:
        np.testing.assert_equal(read(after), read(before))
    except (AssertionError, KeyError, AttributeError):
        return False
    return True


def table(figures: results.Figures) -> str:
    """Return a row for each library."""
    rows = [[name, *(", ".join(part) or "–" for part in parts)] for name, parts in figures.items()]
    return results.markdown(["mesh of", "kept as it is", "computed anew", "lost"], rows, numbers=False)


def main(arguments: Sequence[str] | None = None) -> None:
    """Denoise the meshes of every library."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    results.add_option(parser, "round-trips")
    options = parser.parse_args(arguments)
    results.report(options.record, {name: row(make()) for name, make in LIBRARIES.items()}, table)


def installed() -> list[str]:
    """Return the libraries that are installed."""
    return [name for name in LIBRARIES if name == "arrays" or find_spec(name)]


if __name__ == "__main__":
    main()
