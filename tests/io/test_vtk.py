"""Grids of VTK, Gmsh and Abaqus files: what they hold besides positions is kept, and what is lost is named."""

import re

import numpy as np
import pytest
from mixed_sheet import QUADS, SHEET, surface
from sample_files import COFF, PLY_TEXT, read, written
from shapes import icosphere

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.mesh import unit

meshio = pytest.importorskip("meshio")
STYLES = {
    "vtk": [{"fmt_version": v, "binary": b} for v in ("4.2", "5.1") for b in (True, False)],
    "vtu": [{"binary": b} for b in (True, False)],
}
SINGLE = "digits of the positions beyond single precision"
PLY_PENTAGON = b"""ply
format ascii 1.0
element vertex 5
property float x
property float y
property float z
property float heat
property float quality
element face 1
property list uchar int vertex_indices
property int label
end_header
0 0 0 1 2
1 0 0 1 2
1 1 0 1 2
.5 1.5 0 1 2
0 1 0 1 2
5 0 1 2 3 4 7
"""
every_style = pytest.mark.parametrize(("format", "style"), [(f, s) for f in STYLES for s in STYLES[f]])


def sheet() -> "meshio.Mesh":
    """Return triangles, quads and a line with data of several kinds."""
    rng = np.random.default_rng(0)
    count = len(SHEET.vertices)
    cells = [("triangle", SHEET.faces.astype(np.int64)), ("line", np.array([(0, 1)])), ("quad", QUADS)]
    return meshio.Mesh(
        SHEET.vertices,
        cells,
        point_data={"heat": rng.normal(size=count), "Normals": np.tile([0.0, 0, 1], (count, 1))},
        cell_data={"part": [np.arange(len(block), dtype=np.int32) for _, block in cells]},
    )


def stored(format: str, style: dict, tmp_path) -> bytes:
    path = tmp_path / f"sheet.{format}"
    getattr(meshio, format).write(path, sheet(), **style)
    return path.read_bytes()


@every_style
def test_grids_keep_their_data(format, style, tmp_path):
    data = stored(format, style, tmp_path)
    file = read(data, format)
    assert written(file) == data
    assert len(file.mesh.faces) == len(SHEET.faces) + 4
    turn = np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)])  # z becomes -y
    moved = tmp_path / f"moved.{format}"
    assert io.write(file.with_vertices(file.mesh.vertices @ turn.T), moved) == list(file.moving_loses)
    found = getattr(meshio, format).read(moved)
    expected = getattr(meshio, format).read(tmp_path / f"sheet.{format}")
    assert np.array_equal(found.points, file.positions @ turn.T)
    assert np.array_equal(found.point_data["heat"], expected.point_data["heat"])
    assert np.allclose(found.point_data["Normals"], np.array((0, 0, 1)) @ turn.T)
    assert [block.type for block in found.cells] == [block.type for block in expected.cells]
    for i, block in enumerate(expected.cells):
        assert np.array_equal(found.cells[i].data, block.data)
        assert np.array_equal(found.cell_data["part"][i], expected.cell_data["part"][i])
    if format == "vtk":
        first, _, kind = moved.read_bytes().split(b"\n")[:3]
        assert first.endswith(b"4.2")  # which VTK and meshio both read
        assert kind == (b"BINARY" if style["binary"] else b"ASCII")


def test_normals_of_cells_follow(tmp_path):
    ball = icosphere(2)
    data = {"normals": [ball.face_normals.astype(np.float32)]}
    mesh = meshio.Mesh(ball.vertices, [("triangle", ball.faces.astype(np.int64))], cell_data=data)
    mesh.write(tmp_path / "ball.vtu")
    file = cn.read(tmp_path / "ball.vtu")
    io.write(file.with_vertices(ball.vertices * (1, 2, 3)), tmp_path / "moved.vtu")
    moved = meshio.read(tmp_path / "moved.vtu")
    expected = ball.moved(ball.vertices * (1, 2, 3)).face_normals
    assert np.allclose(moved.cell_data["normals"][0], unit(expected), atol=1e-6)


@pytest.mark.parametrize("format", ["vtk", "vtu"])
@pytest.mark.parametrize("source", [PLY_TEXT, COFF])
def test_conversion_keeps_values(format, source, tmp_path):
    file = read(source)
    lost = io.write(file, tmp_path / f"a.{format}")
    again = cn.read(tmp_path / f"a.{format}").content()
    assert np.array_equal(again.positions, file.positions)
    order = np.argsort(file.polygons.counts, kind="stable")
    assert np.array_equal(again.polygons.counts, file.polygons.counts[order])
    before = file.content()
    for name, value in before.vertex_values.items():
        assert np.array_equal(again.vertex_values[name], value)
    for name, value in before.face_values.items():
        assert np.array_equal(again.face_values[name], value[order])
    assert ("the order of the faces" in lost) == (order != np.arange(len(order))).any()
    assert io.write(cn.read(tmp_path / f"a.{format}"), tmp_path / "back.ply") == []


def test_abaqus_files_name_the_values_that_they_lose(tmp_path):
    values = ["vertex property 'heat'", "vertex property 'quality'", "face property 'label'"]
    data = PLY_PENTAGON.replace(b"5 0 1 2 3 4 7", b"3 0 1 2 7")
    assert io.write(read(data), tmp_path / "a.inp") == values


def test_elements_of_abaqus_files_keep_their_types(tmp_path):
    rows = [b"*NODE", b"3, 0, 0, 0", b"5, 1, 0, 0", b"7, 1, 1, 0", b"9, 0, 1, 0"]
    rows += [b"*ELEMENT, TYPE=S3R", b"2, 3, 5, 7", b"*Element, elset=E, type=S4R", b"8, 3, 5, 7, 9", b""]
    file = read(b"\n".join(rows))
    (lost,) = io.write(file.with_vertices(file.mesh.vertices + 1), tmp_path / "a.inp")
    assert "(numbers of nodes and elements, and all but nodes" in lost
    made = (tmp_path / "a.inp").read_text()
    assert re.findall("TYPE=(.*)", made) == ["S3R", "S4R"] and "\n1,1,2,3\n" in made
    assert np.array_equal(cn.read(tmp_path / "a.inp").mesh.vertices, file.mesh.vertices + 1)


def test_abaqus_files_from_other_formats_have_shell_elements(tmp_path):
    cn.write(cn.from_arrays(SHEET.vertices, SHEET.faces), tmp_path / "a.ply")
    io.write(cn.read(tmp_path / "a.ply"), tmp_path / "a.inp")
    assert re.findall("TYPE=(.*)", (tmp_path / "a.inp").read_text()) == ["S3"]
    assert np.array_equal(cn.read(tmp_path / "a.inp").mesh.faces, SHEET.faces)


@pytest.mark.parametrize("format", ["msh", "inp"])
def test_polygons_that_a_format_cannot_hold_are_refused(format, tmp_path):
    words = f"the format '{format}' holds triangles and quads only, and 1 face has another number of corners: write ply"
    with pytest.raises(cn.OutputError, match=words):
        io.write(read(PLY_PENTAGON), tmp_path / f"a.{format}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("format", "content", "words"),
    [
        ("vtk", b"# vtk DataFile Version 4.2\nx\nASCII\nDATASET POLYDATA\nPOINTS 9 f", "VTK cannot read this as vtk"),
        ("vtk", b"# vtk DataFile Version 4.2\nx\nASCII\n", "meshio cannot read this as vtk"),
        (
            "vtk",
            b"# vtk DataFile Version 4.2\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS x float\n",
            "meshio cannot read this as vtk: .",
        ),
        ("vtp", b'<VTKFile type="PolyData">', "VTK cannot read this as vtp"),
        ("msh", b"$MeshFormat\n", "meshio cannot read this as msh: ."),
        ("inp", b"*INCLUDE, INPUT=/etc/passwd\n", "includes other files, which are not read"),
        ("vtu", b'<VTKFile type="UnstructuredGrid" compressor="vtkLZ4DataCompressor">', "is compressed with LZ4"),
        ("vtu", b"<VTKFile>", "meshio cannot read this as vtu"),
        ("vtu", b"\0\1\2", "meshio cannot read this as vtu"),
    ],
)
def test_damaged_grids_are_refused(format, content, words):
    with pytest.raises(io.ReadError, match=words):
        read(content, format)


def test_scalars_of_a_legacy_grid_are_numbers():
    head = b"# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 3 float\n0 0 0 1 0 0 0 1 0\n"
    cells = b"CELLS 1 4\n3 0 1 2\nCELL_TYPES 1\n5\n"
    values = b"%s\nSCALARS %s float\nLOOKUP_TABLE default\n"
    data = head + cells + values % (b"POINT_DATA 3", b"heat") + b"1 2 3\n" + values % (b"CELL_DATA 1", b"part") + b"7\n"
    content = read(data).content()
    assert content.vertex_values["heat"].tolist() == [1, 2, 3] and content.face_values["part"].tolist() == [7]
    assert not content.left_out


@pytest.mark.parametrize("version", [42, 51])
@pytest.mark.parametrize("binary", [True, False])
def test_grids_that_vtk_wrote_keep_arrays_of_all_types(version, binary, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    from vtkmodules.vtkIOLegacy import vtkUnstructuredGridWriter

    grid, count = pyvista.UnstructuredGrid({5: SHEET.faces}, SHEET.vertices), len(SHEET.vertices)
    for kind in ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8"):
        grid.point_data[kind] = np.arange(count).astype(kind)
        grid.cell_data[kind] = np.arange(len(SHEET.faces)).astype(kind)
    grid.point_data["colors"] = np.arange(3 * count, dtype=np.uint8).reshape(-1, 3)
    grid.point_data["up"] = np.tile([0.0, 0, 1], (count, 1))
    grid.point_data["uv"] = SHEET.vertices[:, :2].copy()
    for kind, name in (("Scalars", "colors"), ("Normals", "up"), ("TCoords", "uv")):
        getattr(grid.GetPointData(), f"SetActive{kind}")(name)
    writer = vtkUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetFileVersion(version)
    writer.SetFileType(2 if binary else 1)
    writer.SetFileName(str(tmp_path / "a.vtk"))
    writer.Write()
    file = cn.read(tmp_path / "a.vtk")
    io.write(file.with_vertices(file.mesh.vertices + 1), tmp_path / "b.vtk")
    found = pyvista.read(tmp_path / "b.vtk")
    assert np.array_equal(found.points, grid.points + 1)
    for name in ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8", "up"):
        assert np.array_equal(found.point_data[name], grid.point_data[name])
        assert found.point_data[name].dtype == grid.point_data[name].dtype
    assert all(np.array_equal(found.cell_data[name], grid.cell_data[name]) for name in grid.cell_data)
    assert np.array_equal(found.point_data["uv"][:, :2], grid.point_data["uv"])  # meshio makes it three columns
    scale = 1 if binary else 255  # VTK writes colours in text as fractions
    np.testing.assert_allclose(found.point_data["colors"] * scale, grid.point_data["colors"], atol=0.01)


@pytest.mark.parametrize("version", [42, 51])
@pytest.mark.parametrize("binary", [True, False])
def test_tensors_and_numbers_of_points_in_grids_of_vtk_are_kept(binary, version, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    vtk = pytest.importorskip("vtkmodules.vtkIOLegacy")
    grid, count = pyvista.UnstructuredGrid({5: SHEET.faces}, SHEET.vertices), len(SHEET.vertices)
    stress, numbers = np.arange(9.0 * count).reshape(count, 9), np.arange(count)[::-1].copy()
    grid.point_data["stress"], grid.point_data["number"] = stress, numbers
    grid.GetPointData().SetActiveScalars(None)
    grid.GetPointData().SetActiveTensors("stress")
    grid.GetPointData().SetGlobalIds(grid.GetPointData().GetArray("number"))
    writer = vtk.vtkUnstructuredGridWriter()
    writer.SetFileName(str(tmp_path / "a.vtk"))
    writer.SetInputData(grid)
    writer.SetFileVersion(version)
    writer.SetFileTypeToBinary() if binary else writer.SetFileTypeToASCII()
    writer.Write()
    data = (tmp_path / "a.vtk").read_bytes()
    assert b"\nTENSORS stress" in data and b"\nGLOBAL_IDS number" in data
    file = cn.read(tmp_path / "a.vtk")
    assert file.content().vertex_values["number"].tolist() == numbers.tolist()
    io.write(file.with_vertices(file.mesh.vertices + 1), tmp_path / "b.vtk")
    for found in (pyvista.read(tmp_path / "b.vtk").point_data, meshio.read(tmp_path / "b.vtk").point_data):
        np.testing.assert_allclose(np.reshape(found["stress"], (count, 9)), stress)
        assert np.ravel(found["number"]).tolist() == numbers.tolist()


def test_bits_in_a_grid_of_vtk_are_kept_as_bytes(tmp_path):
    meshio.vtk.write(tmp_path / "a.vtk", sheet(), fmt_version="4.2", binary=False)
    count = len(SHEET.vertices)
    bits = f"POINT_DATA {count}\nSCALARS inside bit 1\nLOOKUP_TABLE default\n{' '.join('01' * (count // 2))}\n"
    data = (tmp_path / "a.vtk").read_bytes()
    file = read(data[: data.index(b"POINT_DATA")] + bits.encode(), "vtk")
    again = read(written(file.with_vertices(file.mesh.vertices + 1)), "vtk")
    assert again.content().vertex_values["inside"].tolist() == [0, 1] * (count // 2)


@pytest.mark.parametrize("format", ["vtk", "vtu"])
def test_texts_in_a_grid_are_refused_with_what_to_do(format, tmp_path):
    grid = pytest.importorskip("pyvista").UnstructuredGrid({5: SHEET.faces}, SHEET.vertices)
    grid.field_data["by"] = ["someone"]
    grid.save(tmp_path / f"a.{format}")
    with pytest.raises(io.ReadError, match=r"holds an array of texts, .* save the surface as vtp"):
        cn.read(tmp_path / f"a.{format}")
    if format == "vtu":  # as ParaView writes it
        writer = pytest.importorskip("vtkmodules.vtkIOXML").vtkXMLUnstructuredGridWriter()
        writer.SetFileName(str(tmp_path / "b.vtu"))
        writer.SetInputData(grid)
        writer.SetDataModeToAppended()
        writer.EncodeAppendedDataOff()
        writer.Write()
        with pytest.raises(io.ReadError, match=r"holds an array of texts, .* save the surface as vtp"):
            cn.read(tmp_path / "b.vtu")


def test_volumes_are_refused(tmp_path):
    meshio.Mesh(np.eye(4)[:, :3], [("tetra", np.array([(0, 1, 2, 3)]))]).write(tmp_path / "a.vtu")
    with pytest.raises(io.ReadError, match="cells of type tetra: extract the surface"):
        cn.read(tmp_path / "a.vtu")


@pytest.mark.parametrize(
    ("format", "module", "style"),
    [
        ("msh", "gmsh", {"fmt_version": "4.1", "binary": True}),
        ("msh", "gmsh", {"fmt_version": "2.2", "binary": False}),
        ("inp", "abaqus", {}),
    ],
)
def test_meshes_of_simulations_are_moved(format, module, style, tmp_path, monkeypatch):
    """A Gmsh file stays text or binary."""
    monkeypatch.chdir(tmp_path)
    points, triangles = SHEET.vertices, SHEET.faces.astype(np.int64)
    library = getattr(meshio, module)
    cells = [("triangle", triangles), ("quad", QUADS)][: 1 if style.get("fmt_version") == "4.1" else 2]
    library.write(f"in.{format}", meshio.Mesh(points, cells), **style)
    assert run(["denoise", f"in.{format}", "-o", f"out.{format}", "--method", "laplacian"]) == 0
    source, found = cn.read(f"in.{format}"), library.read(f"out.{format}")
    expected = cn.denoise(source.mesh, method="laplacian").vertices
    np.testing.assert_allclose(found.points, expected, rtol=1e-12, atol=1e-12)
    assert [(block.type, block.data.tolist()) for block in found.cells] == [(kind, c.tolist()) for kind, c in cells]
    if format == "msh":
        kinds = [(tmp_path / name).read_bytes().split(b"\n")[1].split()[1] for name in ("in.msh", "out.msh")]
        assert kinds == [b"1" if style["binary"] else b"0"] * 2
    io.write(read(PLY_TEXT), f"made.{format}")
    assert len(cn.read(f"made.{format}").mesh.faces) == len(read(PLY_TEXT).mesh.faces)


def test_texts_and_field_data_are_named_where_a_format_cannot_hold_them(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    made = pyvista.PolyData.from_regular_faces(SHEET.vertices, SHEET.faces)
    made.field_data["time"] = [0.5]
    made.save(tmp_path / "a.vtk")
    made.cast_to_unstructured_grid().save(tmp_path / "a.vtu")
    made.field_data["SPACE"] = ["RAS"]
    made.point_data["who"] = ["a"] * made.n_points
    made.cell_data["what"] = ["b"] * made.n_cells
    made.save(tmp_path / "a.vtp")
    texts = ["point data 'who'", "cell data 'what'"]
    for format, names in ("vtk", ["time"]), ("vtu", ["time"]), ("vtp", ["time", "SPACE"]):
        lost = io.write(cn.read(tmp_path / f"a.{format}"), tmp_path / f"{format}.ply")
        assert lost == [*(texts if format == "vtp" else []), *(f"field data '{name}'" for name in names)]


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_the_title_of_a_legacy_file_stays(binary, end, tmp_path):
    """3D Slicer writes the coordinate system there, without which it would show the mesh elsewhere."""
    pyvista = pytest.importorskip("pyvista")
    title = b"3D Slicer output. SPACE=RAS"
    for made in (surface(pyvista), pyvista.UnstructuredGrid({5: SHEET.faces}, SHEET.vertices)):
        made.save(tmp_path / "a.vtk", binary=binary)
        first, _, rest = (tmp_path / "a.vtk").read_bytes().split(b"\n", 2)
        data = end.join([first, title, rest])
        file = read(data, "vtk")
        moved = b"".join(file.with_vertices(file.mesh.vertices * 2).pieces())
        assert moved.splitlines()[1] == title and moved.splitlines()[2] == rest.splitlines()[0]
        assert np.array_equal(read(moved, "vtk").positions, file.positions * 2)


@pytest.mark.parametrize("format", ["vtp", "vtu"])
def test_colours_and_texture_coordinates_of_vtk_are_converted(format, tmp_path):
    """Arrays of the same names that hold other numbers are left out."""
    pyvista = pytest.importorskip("pyvista")
    rng, faces = np.random.default_rng(0), pyvista.PolyData.from_regular_faces(SHEET.vertices, SHEET.faces)
    made = faces if format == "vtp" else faces.cast_to_unstructured_grid()
    count, cells = len(SHEET.vertices), len(SHEET.faces)
    made.point_data["RGBA"] = colors = rng.integers(0, 255, (count, 4), np.uint8)
    made.point_data["TCoords"] = texture = rng.random((count, 2), np.float32)
    made.cell_data["RGB"] = of_faces = rng.integers(0, 255, (cells, 3), np.uint8)
    made.cell_data["TCoords"] = rng.random((cells, 3))
    made.save(tmp_path / f"a.{format}")
    assert io.write(cn.read(tmp_path / f"a.{format}"), tmp_path / "a.ply") == ["cell data 'TCoords'"]
    values = cn.read(tmp_path / "a.ply").content()
    for found, names, expected in (
        (values.vertex_values, ("red", "green", "blue", "alpha"), colors),
        (values.vertex_values, ("s", "t"), texture),
        (values.face_values, ("red", "green", "blue"), of_faces),
    ):
        np.testing.assert_array_equal(np.stack([found[name] for name in names], axis=1), expected)


@pytest.mark.parametrize("format", ["ply", "usda"])
def test_values_that_would_share_a_name_are_all_kept(format, tmp_path):
    if format == "usda":
        pytest.importorskip("pxr")
    of_points = {"x": 5, "x_": 6, "a b": 7, "a_b": 8, "a  b": 9, "vertex_indices": 10, "part": 11}
    point_data = {name: np.arange(len(SHEET.vertices)) + 10.0 * start for name, start in of_points.items()}
    cell_data = {name: [np.arange(len(SHEET.faces)) + 0.5] for name in ("part", "vertex_index", "vertex_indices")}
    meshio.Mesh(SHEET.vertices, [("triangle", SHEET.faces)], point_data, cell_data).write(tmp_path / "in.vtu")
    assert io.write(io.read(tmp_path / "in.vtu"), tmp_path / f"out.{format}") in ([], [SINGLE])
    found = io.read(tmp_path / f"out.{format}")
    np.testing.assert_allclose(found.mesh.vertices, SHEET.vertices, rtol=1e-6)
    assert np.array_equal(found.mesh.faces, SHEET.faces)
    values = found.content()
    assert sorted(value[0] for value in values.vertex_values.values()) == [10.0 * start for start in of_points.values()]
    assert len(values.face_values) == 3


def test_names_of_properties_beyond_ascii_are_kept(tmp_path):
    meshio.Mesh(SHEET.vertices, [("triangle", SHEET.faces)], {"Höhe": SHEET.vertices[:, 2]}).write(tmp_path / "in.vtu")
    for name in ("a.ply", "b.vtu"):
        io.write(io.read(tmp_path / "in.vtu"), tmp_path / name)
        assert [*io.read(tmp_path / name).content().vertex_values] == ["Höhe"]
    older = (tmp_path / "a.ply").read_bytes().replace("Höhe".encode(), "Höhe".encode("latin-1"))
    assert [*read(older).content().vertex_values] == ["Höhe"]


@pytest.mark.parametrize("kind", [np.int16, np.int32, np.int64])
@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("grid", [True, False])
def test_faces_of_any_integers_that_pyvista_saves_are_read(grid, binary, kind, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    made = pyvista.PolyData.from_regular_faces(SHEET.vertices, SHEET.faces.astype(kind))
    (made.cast_to_unstructured_grid() if grid else made).save(tmp_path / "a.vtk", binary=binary)
    file = cn.read(tmp_path / "a.vtk")
    assert np.array_equal(file.mesh.faces, SHEET.faces)
    io.write(file.with_vertices(file.mesh.vertices + 1), tmp_path / "b.vtk")
    found = pyvista.read(tmp_path / "b.vtk")
    assert np.allclose(found.points, SHEET.vertices + 1) and found.n_cells == len(SHEET.faces)


def test_errors_and_warnings_of_the_libraries_are_not_printed(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    meshio.Mesh(SHEET.vertices, [("triangle", SHEET.faces)]).write("a.vtu")
    assert io.write(cn.read("a.vtu"), tmp_path / "a.msh") == []  # meshio appends tags of zeros
    (tmp_path / "bad.vtp").write_bytes(b'<VTKFile type="PolyData"><PolyData><Piece></PolyData></VTKFile>')
    (tmp_path / "bad.msh").write_bytes((tmp_path / "a.msh").read_bytes().replace(b"$EndNodes", b"$EndNode"))
    capfd.readouterr()
    with pytest.raises(io.ReadError, match=r"meshio cannot read this as msh: \$Nodes not closed by \$EndNodes"):
        cn.read("bad.msh")
    with pytest.raises(io.ReadError, match="VTK cannot read this as vtp: Error parsing XML"):
        cn.read("bad.vtp")
    assert capfd.readouterr() == ("", "")


def test_cells_that_meshio_skips_are_named(tmp_path, capfd):
    cells = [("triangle", SHEET.faces[:-1]), ("wedge", np.arange(6)[None])]
    meshio.vtk.write(tmp_path / "a.vtk", meshio.Mesh(SHEET.vertices, cells), binary=False)
    (tmp_path / "b.vtk").write_bytes((tmp_path / "a.vtk").read_bytes().replace(b"\n13\n", b"\n99\n"))
    capfd.readouterr()
    file = cn.read(tmp_path / "b.vtk")
    lost = io.write(file.with_vertices(file.mesh.vertices + 1), tmp_path / "c.vtk")
    assert lost[-1] == "what meshio skipped (File contains cells that meshio cannot handle (type 99))"
    assert capfd.readouterr() == ("", "")


def test_polygons_of_a_legacy_grid_name_the_data_that_they_lose(tmp_path):
    """Meshio does not read the data of cells if one of them is a polygon."""
    io.write(read(PLY_PENTAGON), tmp_path / "a.vtk")
    file = cn.read(tmp_path / "a.vtk")
    skipped = "what meshio skipped (Skipping the data of cells, some of which are polygons)"
    assert io.write(file.with_vertices(file.mesh.vertices + 1), tmp_path / "b.vtk")[-1] == skipped
    assert io.write(file, tmp_path / "a.ply") == [skipped]


@pytest.mark.parametrize("binary", [True, False])
def test_data_of_gmsh_elements_of_several_kinds_are_kept(binary, tmp_path):
    made = sheet()
    with np.printoptions(legacy="1.21"):
        meshio.gmsh.write(tmp_path / "a.msh", made, fmt_version="2.2", binary=binary)
    file = cn.read(tmp_path / "a.msh")
    order = [*made.cell_data["part"][0], *made.cell_data["part"][2]]
    assert file.content().face_values["part"].tolist() == order
    io.write(file.with_vertices(file.mesh.vertices + 1), tmp_path / "b.msh")
    again = cn.read(tmp_path / "b.msh").content()
    assert again.face_values["part"].tolist() == order
    assert again.vertex_values["heat"].tolist() == made.point_data["heat"].tolist()


GMSH_WITH_A_GROUP = b"""$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
1
2 7 "top"
$EndPhysicalNames
$Entities
0 0 2 0
1 0 0 0 1 1 0 1 7 0
2 0 0 0 1 1 0 0 0
$EndEntities
$Nodes
1 4 1 4
2 1 0 4
1
2
3
4
0 0 0
1 0 0
1 1 0
0 1 0
$EndNodes
$Elements
2 2 1 2
2 1 2 1
1 1 2 3
2 2 2 1
2 1 3 4
$EndElements
"""


def test_only_some_surfaces_of_a_gmsh_file_may_be_in_a_physical_group(tmp_path):
    file = read(GMSH_WITH_A_GROUP)
    assert file.content().face_values["gmsh:physical"].tolist() == [7, 0]
    io.write(file.with_vertices(file.mesh.vertices + 1), tmp_path / "b.msh")
    again = cn.read(tmp_path / "b.msh")
    assert again.content().face_values["gmsh:physical"].tolist() == [7, 0]
    without = read(GMSH_WITH_A_GROUP.replace(b"1 7 0", b"0 0"))
    assert "gmsh:physical" not in without.content().face_values


def test_a_binary_grid_may_end_without_a_line_end(tmp_path):
    """Gmsh writes such files."""
    meshio.vtk.write(tmp_path / "a.vtk", sheet(), fmt_version="4.2", binary=True)
    data = (tmp_path / "a.vtk").read_bytes()
    assert data.endswith(b"\n") and data.rindex(b"\n") == len(data) - 1
    cut = read(data[:-1], "vtk").content()
    assert cut.face_values["part"].tolist() == read(data, "vtk").content().face_values["part"].tolist()


def test_data_that_only_some_elements_of_a_gmsh_file_have_are_named(tmp_path, capfd):
    meshio.gmsh.write(
        tmp_path / "a.msh", meshio.Mesh(SHEET.vertices, [("triangle", SHEET.faces)]), fmt_version="2.2", binary=False
    )
    few = b'$ElementData\n1\n"part"\n1\n0.0\n3\n0\n1\n1\n1 0.5\n$EndElementData\n'
    (tmp_path / "a.msh").write_bytes((tmp_path / "a.msh").read_bytes() + few)
    capfd.readouterr()
    skipped = "what meshio skipped (skipping 'part', which only some elements have)"
    assert io.write(cn.read(tmp_path / "a.msh"), tmp_path / "a.ply")[0] == skipped
    assert capfd.readouterr() == ("", "")
