"""Formats that other packages read and write: what they hold of a file is kept, the rest is named."""

import io as streams
import re

import numpy as np
import pytest
from shapes import grid, icosphere
from test_io import COFF, PLY_TEXT, read, written

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.io import files
from cascadenorm.io.files import output_format
from cascadenorm.mesh import unit

meshio = pytest.importorskip("meshio")

SHEET = grid(2, 3)
QUADS = np.array([(0, 1, 5, 4), (1, 2, 6, 5)])
STYLES = {
    "vtk": [{"fmt_version": v, "binary": b} for v in ("4.2", "5.1") for b in (True, False)],
    "vtu": [{"binary": b} for b in (True, False)],
}
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
        assert first.endswith(style["fmt_version"].encode())
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


@pytest.mark.parametrize(
    ("format", "content", "words"),
    [
        ("vtk", b"# vtk DataFile Version 4.2\nx\nASCII\nDATASET POLYDATA\n", "meshio cannot read this as vtk"),
        ("vtk", b"# vtk DataFile Version 4.2\nx\nASCII\n", "meshio cannot read this as vtk"),
        ("vtu", b"<VTKFile>", "meshio cannot read this as vtu"),
        ("vtu", b"\0\1\2", "meshio cannot read this as vtu"),
    ],
)
def test_damaged_grids_are_refused(format, content, words):
    with pytest.raises(io.ReadError, match=words):
        read(content, format)


def test_volumes_are_refused(tmp_path):
    meshio.Mesh(np.eye(4)[:, :3], [("tetra", np.array([(0, 1, 2, 3)]))]).write(tmp_path / "a.vtu")
    with pytest.raises(io.ReadError, match="cells of type tetra: extract the surface"):
        cn.read(tmp_path / "a.vtu")


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(files, "is_installed", lambda: False)
    monkeypatch.setattr("cascadenorm.io.via_trimesh.trimesh_formats", list)
    for format, packages in {"vtu": "meshio", "3mf": "lxml networkx", "dae": "pycollada"}.items():
        words = re.escape(
            f"'{format}' files needs {packages}, which is not installed: pip install \"cascadenorm[formats]"
        )
        with pytest.raises(cn.MissingDependencyError, match=words):
            io.read(streams.BytesIO(b"anything"), format)
        with pytest.raises(cn.MissingDependencyError, match=words):
            output_format(f"a.{format}")


@pytest.mark.parametrize(("format", "needs"), [("3mf", "lxml"), ("dae", "collada")])
def test_scenes_of_trimesh_are_moved_mesh_by_mesh(format, needs, tmp_path):
    pytest.importorskip(needs)
    import trimesh

    box, ball = trimesh.creation.box(), trimesh.creation.icosphere(subdivisions=1)
    scene = trimesh.Scene([box])
    scene.add_geometry(ball, transform=trimesh.transformations.translation_matrix((5, 0, 0)))
    path = tmp_path / f"scene.{format}"
    if format == "3mf":
        scene.export(path)
    else:
        path.write_bytes(trimesh.exchange.dae.export_collada(scene.dump()))
    file = cn.read(path)
    assert io.write(file, tmp_path / f"same.{format}") == []
    assert (tmp_path / f"same.{format}").read_bytes() == path.read_bytes()
    lost = io.write(file.with_vertices(file.mesh.vertices * 2), tmp_path / f"twice.{format}")
    assert lost == list(file.moving_loses)
    found = cn.read(tmp_path / f"twice.{format}").mesh
    assert found.area == pytest.approx(4 * (box.area + ball.area))
    assert len(found.faces) == len(box.faces) + len(ball.faces)
