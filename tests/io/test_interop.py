"""Arrays and meshes of other libraries come back in their kind, with all that they hold."""

import numpy as np
import pytest
import trimesh
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.io.interop import adapter

BALL = noisy(icosphere(2), 0.2)
METHOD = {"method": "bilateral-normal"}


def test_arrays_come_back_as_a_copy_in_their_type():
    for vertices in (BALL.vertices, BALL.vertices.astype(np.float32), BALL.vertices.astype(">f8")):
        out = cn.denoise(vertices, BALL.faces, strength=0, **METHOD)
        assert out.dtype == vertices.dtype
        assert not np.shares_memory(out, vertices)
        np.testing.assert_array_equal(out, vertices)
    whole = np.round(BALL.vertices * 100).astype(int)
    out = cn.denoise(whole.tolist(), BALL.faces.tolist(), **METHOD)
    assert out.dtype == np.float64 and (out != whole).any()


def test_single_precision_is_worked_on_in_double():
    vertices = BALL.vertices.astype(np.float32)
    out = cn.denoise(vertices, BALL.faces, **METHOD)
    np.testing.assert_array_equal(out, cn.denoise(vertices.astype(float), BALL.faces, **METHOD).astype(np.float32))


def test_a_primitive_of_trimesh_comes_back_as_a_mesh_with_its_attributes():
    ball = trimesh.primitives.Sphere(subdivisions=2)
    ball.visual.face_colors, ball.metadata["unit"] = np.arange(320)[:, None] % 256 * np.ones(4, np.uint8), "mm"
    ball.vertex_attributes["heat"], ball.face_attributes["part"] = np.arange(162.0), np.arange(320)
    out = cn.denoise(ball, method="laplacian")
    np.testing.assert_array_equal(out.vertices, cn.denoise(ball.vertices, ball.faces, method="laplacian"))
    np.testing.assert_array_equal(out.visual.face_colors, ball.visual.face_colors)
    np.testing.assert_array_equal(out.vertex_attributes["heat"], np.arange(162.0))
    np.testing.assert_array_equal(out.face_attributes["part"], np.arange(320))
    assert out.metadata["unit"] == "mm" and ball.metadata is not out.metadata


def test_trimesh_comes_back_with_its_attributes():
    mesh = trimesh.Trimesh(BALL.vertices, BALL.faces, process=False, metadata={"unit": "mm"})
    mesh.vertex_attributes["heat"] = np.arange(162.0)
    mesh.visual.face_colors = np.tile([10, 20, 30, 255], (320, 1))
    before = mesh.vertices.tobytes()
    out = cn.denoise(mesh, **METHOD)
    assert type(out) is trimesh.Trimesh and out is not mesh
    assert mesh.vertices.tobytes() == before
    np.testing.assert_array_equal(out.vertices, cn.denoise(BALL, **METHOD).vertices)
    np.testing.assert_array_equal(out.faces, mesh.faces)
    np.testing.assert_array_equal(out.vertex_attributes["heat"], np.arange(162.0))
    np.testing.assert_array_equal(out.visual.face_colors, mesh.visual.face_colors)
    assert out.metadata["unit"] == "mm"


def test_pyvista_comes_back_with_its_arrays():
    pyvista = pytest.importorskip("pyvista")
    mesh = pyvista.PolyData.from_regular_faces(BALL.vertices.astype(np.float32), BALL.faces)
    mesh.point_data["heat"] = np.arange(162.0)
    mesh.point_data["Normals"] = np.zeros((162, 3), np.float32)
    out = cn.denoise(mesh, **METHOD)
    expected = cn.denoise(BALL.vertices.astype(np.float32), BALL.faces, **METHOD)
    np.testing.assert_array_equal(out.points, expected)
    np.testing.assert_array_equal(mesh.points, BALL.vertices.astype(np.float32))
    np.testing.assert_array_equal(out.point_data["heat"], np.arange(162.0))
    np.testing.assert_allclose(np.linalg.norm(out.point_data["Normals"], axis=1), 1, rtol=1e-6)
    with pytest.raises(cn.MeshError, match="triangulate"):
        cn.denoise(pyvista.Plane(), **METHOD)


def test_datasets_without_faces_are_refused_as_arrays_without_faces_are():
    pyvista = pytest.importorskip("pyvista")
    for data in (pyvista.PolyData(BALL.vertices), pyvista.Line()):
        with pytest.raises(cn.MeshError, match="the mesh has no faces: reconstruct a surface from the points first"):
            cn.denoise(data)
    with pytest.raises(cn.MeshError, match="the mesh has no vertices and no faces: there is nothing to denoise"):
        cn.denoise(pyvista.PolyData())


def test_meshio_comes_back_with_its_data():
    meshio = pytest.importorskip("meshio")
    mesh = meshio.Mesh(BALL.vertices, [("triangle", BALL.faces)], point_data={"heat": np.arange(162.0)})
    out = cn.denoise(mesh, **METHOD)
    np.testing.assert_array_equal(out.points, cn.denoise(BALL, **METHOD).vertices)
    np.testing.assert_array_equal(mesh.points, BALL.vertices)
    np.testing.assert_array_equal(out.point_data["heat"], np.arange(162.0))
    with pytest.raises(cn.MeshError, match="quad"):
        cn.denoise(meshio.Mesh(BALL.vertices, [("quad", [[0, 1, 2, 3]])]), **METHOD)


def test_normals_of_meshio_are_renewed():
    meshio = pytest.importorskip("meshio")
    names, normals = ("nx", "ny", "nz"), BALL.vertex_normals.astype(np.float32)
    mesh = meshio.Mesh(
        BALL.vertices,
        [("triangle", BALL.faces[:100]), ("vertex", [[3]]), ("triangle", BALL.faces[100:])],
        point_data={"Normals": -normals, **dict(zip(names, normals.T, strict=True))},
        cell_data={"Normals": [BALL.face_normals[:100], np.ones((1, 3)), BALL.face_normals[100:]]},
    )
    out = cn.denoise(mesh, **METHOD)
    expected = cn.denoise(BALL, **METHOD)
    np.testing.assert_allclose(out.point_data["Normals"], -expected.vertex_normals, atol=1e-6)
    np.testing.assert_allclose(np.stack([out.point_data[n] for n in names], 1), expected.vertex_normals, atol=1e-6)
    first, other, last = out.cell_data["Normals"]
    np.testing.assert_allclose(np.concatenate([first, last]), expected.face_normals, atol=1e-12)
    np.testing.assert_array_equal(other, np.ones((1, 3)))
    np.testing.assert_array_equal(mesh.point_data["nx"], normals[:, 0])


def test_a_tensor_mesh_of_open3d_is_refused_with_the_way_out():
    tensor = type("TriangleMesh", (), {"__module__": "open3d.cpu.pybind.t.geometry"})
    with pytest.raises(cn.MeshError, match="to_legacy"):
        cn.denoise(tensor())


def test_open3d_comes_back_with_its_colors():
    open3d = pytest.importorskip("open3d", exc_type=ImportError)
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(BALL.vertices.copy()), open3d.utility.Vector3iVector(BALL.faces.copy())
    )
    mesh.paint_uniform_color([0.1, 0.2, 0.3])
    out = cn.denoise(mesh, **METHOD)
    np.testing.assert_array_equal(np.asarray(out.vertices), cn.denoise(BALL, **METHOD).vertices)
    np.testing.assert_array_equal(np.asarray(mesh.vertices), BALL.vertices)
    assert out.has_vertex_colors()


def test_other_objects_are_refused():
    with pytest.raises(cn.MeshError, match=r"builtins\.dict is not a supported kind of mesh"):
        adapter({})
    with pytest.raises(cn.MeshError, match=r"ndarray is not a supported kind of mesh: pass the faces too"):
        cn.denoise(BALL.vertices)
    with pytest.raises(cn.MeshError, match=r"Scene is not a supported kind of mesh: pass scene\.to_mesh\(\)"):
        cn.denoise(trimesh.Scene(trimesh.creation.box()))
    with pytest.raises(cn.MeshError, match=r"Grid is not a supported kind of mesh: pass .*\.extract_surface\(\)"):
        cn.denoise(pytest.importorskip("pyvista").Sphere().cast_to_unstructured_grid())


def test_meshes_of_several_blocks_are_refused_with_what_to_do():
    pyvista = pytest.importorskip("pyvista")
    from vtkmodules.vtkCommonDataModel import vtkMultiBlockDataSet

    blocks = r"MultiBlock is not a supported kind of mesh: pass its surface, blocks\.combine.* or denoise its blocks"
    with pytest.raises(cn.MeshError, match=blocks):
        cn.denoise(pyvista.MultiBlock([pyvista.Sphere()]))
    with pytest.raises(cn.MeshError, match=r"Set is not .* by vtkCompositeDataGeometryFilter .* or denoise its blocks"):
        cn.denoise(vtkMultiBlockDataSet())
