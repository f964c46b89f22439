"""PolyData of VTK, legacy and XML: what it holds is kept, and what was cut is refused."""

import numpy as np
import pytest
from mixed_sheet import SHEET, surface
from sample_files import PLY_TEXT, read, written

import cascadenorm as cn
from cascadenorm import io

pytest.importorskip("pyvista")


@pytest.mark.parametrize(("format", "binary"), [("vtp", True), ("vtp", False), ("vtk", True), ("vtk", False)])
def test_polydata_is_moved_and_keeps_its_data(format, binary, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    made, path, moved = surface(pyvista), tmp_path / f"a.{format}", tmp_path / f"b.{format}"
    made.save(path, binary=binary)
    file = cn.read(path)
    assert len(file.polygons) == len(SHEET.faces) + 2 and len(file.mesh.faces) == len(SHEET.faces) + 4
    assert written(file) == path.read_bytes()
    turn = np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)])  # z becomes -y
    assert io.write(file.with_vertices(file.mesh.vertices @ turn.T), moved) == list(file.moving_loses)
    found, made = pyvista.read(moved), pyvista.read(path)
    np.testing.assert_allclose(found.points, made.points @ turn.T)
    assert np.array_equal(found.faces, made.faces) and np.array_equal(found.lines, made.lines)
    assert np.array_equal(found.point_data["heat"], made.point_data["heat"])
    np.testing.assert_allclose(found.point_data["Normals"], np.tile(np.array((0, 0, 1)) @ turn.T, (made.n_points, 1)))
    assert np.array_equal(found.cell_data["part"], made.cell_data["part"])
    content = file.content()
    assert content.face_values["part"].tolist() == list(range(1, made.n_cells))  # the line comes first
    assert set(content.left_out) == {"point data 'Normals'", "points and lines"}
    if format == "vtk":
        kinds = [p.read_bytes().split(b"\n")[2] for p in (path, moved)]
        assert kinds == [b"BINARY" if binary else b"ASCII"] * 2


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_coordinates_in_legacy_polydata_in_text_keep_their_digits(kind, tmp_path):
    """VTK would write 5432109.5 as 5.43211e+06."""
    pyvista = pytest.importorskip("pyvista")
    made = surface(pyvista)
    made.points = made.points.astype(kind)
    made.save(tmp_path / "a.vtk", binary=False)
    file = cn.read(tmp_path / "a.vtk")
    assert file.positions.dtype == kind
    moved = file.with_vertices(file.mesh.vertices + np.array([np.pi, 5432109.5, 0]))
    for name in ("b.vtk", "b.ply"):
        io.write(moved, tmp_path / name)
        assert np.array_equal(cn.read(tmp_path / name).positions, moved.positions)
    assert np.array_equal(pyvista.read(tmp_path / "b.vtk").points, moved.positions)


def test_polydata_is_written_with_values(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    file = read(PLY_TEXT)
    assert io.write(file, tmp_path / "a.vtp") == [
        "property 'vertex1' of 'edge'",
        "property 'vertex2' of 'edge'",
        "comments",
    ]
    made = pyvista.read(tmp_path / "a.vtp")
    assert made.n_cells == 3
    np.testing.assert_array_equal(made.points, file.positions)
    assert made.cell_data["material"].tolist() == file.content().face_values["material"].tolist()
    assert made.point_data["red"].tolist() == file.content().vertex_values["red"].tolist()


def test_polydata_that_announces_more_than_it_holds_is_refused():
    head = b'<VTKFile type="PolyData"><PolyData><Piece NumberOfPoints="999999999" NumberOfPolys="1">'
    with pytest.raises(io.ReadError, match="the points and cells of this file need"):
        read(head, "vtp")


@pytest.mark.parametrize("kind", [b"vtktypeint64", b"vtkIdType"])
def test_cells_of_legacy_polydata_may_be_of_either_integer_type(kind, tmp_path):
    """VTK writes vtkIdType for meshes that it has joined."""
    pyvista = pytest.importorskip("pyvista")
    surface(pyvista).save(tmp_path / "a.vtk", binary=False)
    data = (tmp_path / "a.vtk").read_bytes()
    assert b" vtktypeint64" in data
    file = read(data.replace(b"vtktypeint64", kind), "vtk")
    assert np.array_equal(file.mesh.faces, read(data, "vtk").mesh.faces)
    io.write(file.with_vertices(file.mesh.vertices + 1), tmp_path / "b.vtk")
    assert np.allclose(pyvista.read(tmp_path / "b.vtk").points, SHEET.vertices + 1)


def test_legacy_polydata_in_text_that_is_cut_within_its_numbers_is_refused(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    vtk = pytest.importorskip("vtkmodules.vtkIOLegacy")
    made = surface(pyvista)
    made.GetPointData().SetActiveNormals("Normals")  # written last
    writer = vtk.vtkPolyDataWriter()
    writer.SetFileName(str(tmp_path / "a.vtk"))
    writer.SetInputData(made)
    writer.Write()
    data = (tmp_path / "a.vtk").read_bytes()
    assert np.array_equal(read(data.rstrip(), "vtk").positions, read(data, "vtk").positions)
    for start in (data.index(b"POINTS"), data.index(b"CONNECTIVITY"), data.rindex(b"LOOKUP_TABLE")):
        for end in range(start + 60, start + 90):
            with pytest.raises(io.ReadError, match=r"VTK cannot read this as vtk: |there are no faces"):
                read(data[:end], "vtk")
    for end in range(data.rindex(b"Normals"), len(data.rstrip())):
        with pytest.raises(io.ReadError, match="VTK cannot read this as vtk: ") as caught:
            read(data[:end], "vtk")
        assert str(tmp_path.parent.parent) not in str(caught.value) and "surface.vtk" not in str(caught.value)
