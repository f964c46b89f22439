"""Every public function takes a mesh of any kind, and finds the same whatever the kind."""

import pickle
from dataclasses import replace
from inspect import isfunction, signature
from typing import Any

import numpy as np
import pytest
import trimesh
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.mesh import Mesh

CLEAN = icosphere(2)
BALL = noisy(CLEAN, 0.2)
MESH = Mesh(BALL.vertices, np.delete(BALL.faces, [3, 200], axis=0))  # with two holes
TRUTH = Mesh(CLEAN.vertices, MESH.faces)


def vertices_of(result):
    """The vertices of what `denoise` returns for a mesh of any kind."""
    if isinstance(result, np.ndarray):
        return result
    mesh = getattr(result, "mesh", result)
    return np.asarray(mesh.points if hasattr(mesh, "points") else mesh.vertices)


def written(mesh, folder):
    cn.write(mesh, folder / "written.obj")
    return (folder / "written.obj").read_bytes()


def reported(mesh, folder):
    contents = cn.report(folder / "report.html", mesh, truth=TRUTH)
    inspections = {key: replace(found, source="") for key, found in contents.inspections.items()}
    return inspections, contents.measures


FUNCTIONS = {
    "compare": lambda mesh, _: (cn.compare(mesh, TRUTH), cn.compare(TRUTH, mesh)),
    "denoise": lambda mesh, _: vertices_of(cn.denoise(mesh, method="bilateral-normal")),
    "denoise_regions": lambda mesh, _: vertices_of(cn.denoise_regions([mesh], method="bilateral-normal")[0]),
    "farthest_points": lambda mesh, _: cn.farthest_points(mesh, 7),
    "fast_harmonics": lambda mesh, _: cn.fast_harmonics(mesh, 5).values,
    "fill_holes": lambda mesh, _: cn.fill_holes(mesh).vertices,
    "geodesic_distances": lambda mesh, _: cn.geodesic_distances(mesh, 5),
    "inspect": lambda mesh, _: replace(cn.inspect(mesh), source=""),
    "manifold_harmonics": lambda mesh, _: cn.manifold_harmonics(mesh, 5).vectors,
    "report": reported,
    "shape_dna": lambda mesh, _: cn.shape_dna(mesh, 5),
    "spectrum": lambda mesh, _: cn.spectrum(mesh, mesh, count=5).values,
    "view": lambda mesh, _: cn.view(mesh, truth=TRUTH).picture,
    "write": written,
}
"""What each public function makes of a mesh, and of a folder to write to."""

WITHOUT_MESH = {
    "denoise_file": "files, written beside each other",
    "denoise_files": "files, by their names",
    "denoise_region_files": "files, by their names",
    "evaluate": "folders of pairs",
    "from_arrays": "arrays, of which it makes a file",
    "methods": "nothing",
    "progress_bar": "a title",
    "read": "files",
    "read_config": "the settings of a training",
    "train": "settings, and folders of meshes",
}
"""Public functions that take no mesh, and what they take."""


def test_each_public_function_is_in_one_of_the_tables():
    functions = {name for name in cn.__all__ if isfunction(getattr(cn, name))}
    assert functions == FUNCTIONS.keys() | WITHOUT_MESH.keys() and not FUNCTIONS.keys() & WITHOUT_MESH.keys()


@pytest.mark.parametrize("kind", ["trimesh", "meshio", "pyvista", "pair", "list", "file"])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_mesh_of_any_kind_gives_the_same(name, kind, tmp_path):
    cn.write(MESH, tmp_path / "mesh.ply")
    (tmp_path / "first").mkdir()
    (tmp_path / "second").mkdir()
    given = {
        "trimesh": lambda: trimesh.Trimesh(MESH.vertices, MESH.faces, process=False),
        "meshio": lambda: pytest.importorskip("meshio").Mesh(MESH.vertices, [("triangle", MESH.faces)]),
        "pyvista": lambda: pytest.importorskip("pyvista").PolyData.from_regular_faces(MESH.vertices, MESH.faces),
        "pair": lambda: (MESH.vertices, MESH.faces),
        "list": lambda: [MESH.vertices.tolist(), MESH.faces.tolist()],
        "file": lambda: cn.read(tmp_path / "mesh.ply"),
    }[kind]()
    expected = FUNCTIONS[name](MESH, tmp_path / "first")
    found = FUNCTIONS[name](given, tmp_path / "second")
    if isinstance(expected, np.ndarray):
        np.testing.assert_array_equal(found, expected)
    else:
        assert found == expected


@pytest.mark.parametrize("name", ["farthest_points", "fill_holes", "geodesic_distances", "manifold_harmonics"])
def test_functions_of_geometry_take_paths_and_are_found_by_other_processes(name, tmp_path):
    cn.write(MESH, tmp_path / "mesh.ply")
    function = getattr(cn, name)
    assert next(iter(signature(function).parameters.values())).annotation is Any
    assert pickle.loads(pickle.dumps(function)) is function
    np.testing.assert_array_equal(FUNCTIONS[name](tmp_path / "mesh.ply", None), FUNCTIONS[name](MESH, None))


def test_pairs_that_are_no_mesh_are_refused():
    for function in (cn.shape_dna, cn.farthest_points):
        with pytest.raises(cn.MeshError, match="do not exist"):
            function((MESH.vertices, MESH.faces + 1), 3)
