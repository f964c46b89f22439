"""Copies of vertices that files have split are found again."""

import numpy as np
import pytest
from mesh_files import ply_of
from sample_files import OBJ, read, stl_binary, stl_text, written
from shapes import cube, grid, icosphere

import cascadenorm as cn
from cascadenorm.api.inspection import inspect
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.welding import weld


@pytest.mark.parametrize("data", [stl_binary(), stl_text()])
def test_stl_is_welded_and_never_opens(data):
    file = read(data)
    assert (len(file.positions), len(file.mesh.vertices)) == (12, 4)
    assert file.mesh.volume == pytest.approx(1 / 6)
    moved = read(written(file.with_vertices(file.mesh.vertices + np.arange(12).reshape(4, 3) / 7)))
    assert len(moved.mesh.vertices) == 4
    assert moved.mesh.topology.interior_edges.size == 6


def test_soup_of_a_closed_surface_welds_to_it():
    sphere = icosphere(2)
    corners = sphere.corners.reshape(-1, 3)
    soup = ply_of(corners, np.arange(len(corners)).reshape(-1, 3))
    assert len(soup.mesh.vertices) == len(sphere.vertices)
    assert not soup.mesh.topology.boundary_vertices.any()


def test_surfaces_that_touch_inside_stay_apart():
    box = cube(2)
    twice = ply_of(np.concatenate([box.vertices] * 2), np.concatenate([box.faces, box.faces + len(box.vertices)]))
    assert len(twice.mesh.vertices) == 2 * len(box.vertices)


def test_vertices_that_are_not_finite_are_not_copies_of_one_another():
    sheet = grid(6, 6)
    vertices = sheet.vertices.copy()
    vertices[[1, 3, 5]], vertices[[7, 13]] = np.nan, np.inf
    file = ply_of(vertices, sheet.faces)
    assert inspect(file).not_finite == inspect(vertices, sheet.faces).not_finite
    assert inspect(file).not_finite.first == (1, 3, 5, 7, 13)


def rounded_soup(apart: float) -> tuple[Mesh, bytes]:
    """Return a ball, and an STL of it whose corners are up to `apart` mean edge lengths from where they belong."""
    ball = icosphere(3)
    shift = np.random.default_rng(0).uniform(-0.5, 0.5, (*ball.faces.shape, 3)) * apart * ball.mean_edge_length / 3**0.5
    corners = ball.vertices[ball.faces] + shift
    text = ["solid soup"]
    for facet in corners.tolist():
        lines = "\n".join(f"vertex {x!r} {y!r} {z!r}" for x, y, z in facet)
        text.append(f"facet normal 0 0 0\nouter loop\n{lines}\nendloop\nendfacet")
    return ball, "\n".join([*text, "endsolid"]).encode()


@pytest.mark.compiled
def test_corners_that_nearly_coincide_are_reported_and_joined_on_request(tmp_path, capsys):
    ball, data = rounded_soup(1e-6)
    path = tmp_path / "soup.stl"
    path.write_bytes(data)
    found = inspect(path)
    assert (found.boundary_edges, found.nearly_coincident.count) == (3 * 1280, 3 * 1280 - 642)
    assert run(["denoise", str(path), "-o", str(tmp_path / "a.stl"), "--method", "laplacian"]) == 0
    assert (
        "3198 boundary vertices lie within 0.001 edges of another one, but not joined with it"
        in capsys.readouterr().err
    )
    for length in "0.001 edges", 1e-4 * ball.mean_edge_length:
        done = cn.denoise_file(path, tmp_path / "b.stl", method="laplacian", weld=length, force=True)
        assert (done.vertices, done.nearly_coincident) == (642, 0)
        made = inspect(tmp_path / "b.stl")
        assert made.closed and made.vertices == 642 and made.nearly_coincident.count == 0
    expected = cn.denoise(ball, method="laplacian").vertices
    moved = cn.read(tmp_path / "b.stl").mesh
    np.testing.assert_allclose(moved.vertices[moved.faces], expected[ball.faces], atol=1e-6)


def test_a_weld_joins_chains_within_a_part_only_and_no_interior():
    triangles = np.arange(12).reshape(-1, 3)
    points = np.random.default_rng(0).uniform(size=(12, 3)) * 10
    for step, corner in enumerate((3, 6, 9), 1):
        points[corner] = points[0] + [0.09 * step, 0, 0]
    welds, first = weld(points, triangles, distance=0.1)
    assert welds[[3, 6, 9]].tolist() == [welds[0]] * 3 and len(first) == 9
    parts = np.repeat([0, 0, 1, 1], 3)
    welds, first = weld(points, triangles, parts, distance=0.1)
    assert welds[3] == welds[0] and welds[9] == welds[6] != welds[0] and len(first) == 10
    assert len(weld(points, triangles, distance=0.05)[1]) == 12


@pytest.mark.parametrize("length", ["1 edges", "-1", "far"])
def test_a_weld_of_half_an_edge_is_refused(length, tmp_path):
    _, data = rounded_soup(1e-6)
    (tmp_path / "a.stl").write_bytes(data)
    with pytest.raises(cn.ParameterError, match=r"weld is .*; it must be"):
        cn.denoise_file(tmp_path / "a.stl", method="laplacian", weld=length)


def test_an_invalid_mesh_that_is_to_be_welded_is_named(tmp_path):
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    with pytest.raises(cn.MeshError, match=r"points\.obj: the file has 2 vertices and no faces"):
        cn.denoise_file(tmp_path / "points.obj", weld="0.001 edges")


def test_welding_distinguishes_what_single_precision_does_not():
    vertices = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1e-12, 0, 0), (-1, 0, 0), (-0.0, -1, 0), (0, -1, 0)])
    file = ply_of(vertices, np.array([(0, 1, 2), (3, 4, 5), (0, 4, 6)]))
    assert file.welds.tolist() == [0, 1, 2, 3, 4, 5, 5]


def test_runs_of_hashes_take_no_time():
    for line in (b"#" * 200, b"##\n" * 200):
        assert len(read(line + b"\n" + OBJ, "obj").positions) == len(read(OBJ).positions)
        assert read(line + b"\n" + OBJ).format == "obj"


def test_vertices_inside_a_surface_with_back_faces_do_not_nearly_coincide(tmp_path):
    """Every edge has a front and a back face, so that welding joins nothing, and denoising must not suggest it."""
    sheet = grid(6, 6)
    right = sheet.centroids[:, 0] > 3
    vertices = np.concatenate([sheet.vertices, sheet.vertices + 1e-5])
    faces = np.where(right[:, None], sheet.faces + 49, sheet.faces)
    for number, both in enumerate((faces, np.concatenate([faces, faces[:, ::-1]]))):
        save_mesh(tmp_path / f"{number}.ply", Mesh(vertices, both))
        done = cn.denoise_file(tmp_path / f"{number}.ply", tmp_path / "out.ply", method="laplacian", force=True)
        found = cn.inspect(tmp_path / f"{number}.ply")
        assert done.nearly_coincident == found.nearly_coincident.count == 7 * (number == 0)
