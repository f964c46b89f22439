"""Boundaries become smooth, and their corners stay."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.controls.boundary import boundary_edges, smoothed_boundary
from cascadenorm.mesh import Mesh, unit

SHEET = grid(12, 12)
METHOD = {"method": "bilateral-normal"}


def disc(sides: int) -> Mesh:
    angles = np.arange(sides) * 2 * np.pi / sides
    loop = np.stack([np.cos(angles), np.sin(angles), 0.3 * np.ones(sides)], axis=1)
    faces = [(sides, i, (i + 1) % sides) for i in range(sides)]
    return Mesh(np.concatenate([loop, [[0, 0, 0]]]), faces)


def on_boundary(mesh: Mesh) -> np.ndarray:
    return mesh.topology.boundary_vertices


def off_the_square(vertices: np.ndarray) -> float:
    """Root mean square distance of the sheet's boundary from the square it was, in the plane."""
    x, y = vertices[on_boundary(SHEET), :2].T
    return float(np.sqrt((np.min(np.abs([x, x - 12, y, y - 12]), axis=0) ** 2).mean()))


def test_the_boundary_is_one_loop_in_the_direction_of_its_faces():
    loop = boundary_edges(SHEET)
    np.testing.assert_array_equal(loop.vertices, np.flatnonzero(on_boundary(SHEET)))
    edge, seen = 0, set()
    for _ in range(48):
        seen.add(edge)
        assert loop.edges[edge, 1] == loop.edges[loop.neighbors[edge, 1], 0] and loop.signs[edge, 1] == 1
        edge = int(loop.neighbors[edge, 1])
    assert edge == 0 and len(seen) == 48


def test_a_degenerate_face_adds_no_boundary():
    mesh = Mesh(cube(2).vertices, np.concatenate([cube(2).faces, [[0, 0, 0]]]))
    assert not len(boundary_edges(mesh).edges)


@pytest.mark.parametrize("mesh", [disc(30), SHEET, icosphere(1)], ids=["circle", "square", "closed"])
def test_circles_squares_and_closed_meshes_stay(mesh):
    out = smoothed_boundary(mesh, boundary_edges(mesh), mesh.vertices)
    np.testing.assert_allclose(out, mesh.vertices, rtol=0, atol=1e-12)


@pytest.mark.parametrize("level", [0.05, 0.1, 0.2])
def test_jagged_boundaries_become_smooth_and_corners_stay(level):
    rough = noisy(SHEET, level, seed=1)
    out = smoothed_boundary(rough, boundary_edges(rough), rough.vertices)
    assert off_the_square(out) < 0.5 * off_the_square(rough.vertices)
    corners = [0, 12, 13 * 12, 13 * 13 - 1]
    assert np.linalg.norm(out[corners] - SHEET.vertices[corners], axis=1).max() < 4 * level


def turns(mesh: Mesh, vertices: np.ndarray) -> np.ndarray:
    """Angles between consecutive boundary edges, in degrees."""
    loop = boundary_edges(mesh)
    directions = unit(vertices[loop.edges[:, 1]] - vertices[loop.edges[:, 0]])
    cosines = loop.signs[:, 1] * (directions * directions[loop.neighbors[:, 1]]).sum(axis=1)
    return np.degrees(np.arccos(np.clip(cosines[loop.neighbors[:, 1] >= 0], -1, 1)))


def test_regular_zigzags_vanish_without_shrinking():
    """Cut a disc out of equilateral triangles; some faces at its boundary are ears, with all corners on it."""
    sheet = grid(40, 50)
    x, y, _ = sheet.vertices.T
    plane = sheet.moved(np.stack([x - y / 2, y * 3**0.5 / 2, 0 * x], axis=1))
    center = plane.vertices.mean(axis=0)
    mesh = Mesh(plane.vertices, plane.faces[np.linalg.norm(plane.centroids - center, axis=1) < 13])
    ears = on_boundary(mesh)[mesh.faces].all(axis=1)
    assert ears.sum() > 10 and (turns(mesh, mesh.vertices) > 60 - 1e-9).mean() > 0.3
    out = mesh.moved(smoothed_boundary(mesh, boundary_edges(mesh), mesh.vertices))
    assert (turns(mesh, out.vertices) > 60).mean() < 0.02
    assert (out.area_vectors[:, 2] > 0).all()
    assert abs(out.areas.sum() / mesh.areas.sum() - 1) < 0.01
    spreads = [np.linalg.norm(m.vertices[on_boundary(mesh)] - center, axis=1).std() for m in (mesh, out)]
    assert spreads[1] < 0.5 * spreads[0]


def test_the_corners_of_a_rectangle_with_zigzag_sides_stay():
    x, y, z = SHEET.vertices.T
    rows = SHEET.moved(np.stack([x + (y % 2) / 2, y * 3**0.5 / 2, z], axis=1))
    out = smoothed_boundary(rows, boundary_edges(rows), rows.vertices)
    zigzag, smooth = np.sort(turns(rows, rows.vertices)), np.sort(turns(rows, out))
    assert (zigzag > 60 - 1e-9).sum() > 20  # every vertex of both sides
    assert (smooth > 30).sum() <= 8 and smooth[:-8].max() < 15
    corners = [0, 12, 13 * 12, 13 * 13 - 1]
    assert np.linalg.norm(out[corners] - rows.vertices[corners], axis=1).max() < 0.25


def test_off_the_surface_vertices_go_where_the_method_moved_them():
    rough = noisy(SHEET, 0.1, seed=2)
    moved = cn.denoise(rough, **METHOD).vertices
    out = smoothed_boundary(rough, boundary_edges(rough), moved)
    loop = on_boundary(SHEET)
    around = [np.bincount(rough.faces.ravel(), np.repeat(a, 3)) for a in rough.moved(moved).area_vectors.T]
    normals = unit(np.stack(around, axis=1))
    np.testing.assert_allclose(((out - moved) * normals)[loop].sum(axis=1), 0, atol=1e-12)
    assert np.linalg.norm(out - moved, axis=1)[loop].mean() > 0.02
    np.testing.assert_array_equal(out[~loop], moved[~loop])


def test_the_orientation_of_faces_does_not_matter():
    rough = noisy(SHEET, 0.1, seed=3)
    flip = np.random.default_rng(0).random(len(SHEET.faces)) < 0.5
    mixed = Mesh(rough.vertices, np.where(flip[:, None], rough.faces[:, ::-1], rough.faces))
    plain, other = (
        smoothed_boundary(m.moved(m.vertices * (1, 1, 0)), boundary_edges(m), m.vertices) for m in (rough, mixed)
    )
    inside = np.bincount(SHEET.faces[flip].ravel(), minlength=169) == 0  # normals of the others differ
    np.testing.assert_allclose(other[inside], plain[inside], atol=1e-12)


def test_where_loops_touch_a_vertex_moves_off_the_surface_alone():
    bow = Mesh([[0, 0, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0]], [[0, 2, 1], [0, 4, 3]])
    lifted = bow.vertices + np.array([0.3, 0.2, 0.1])
    out = smoothed_boundary(bow, boundary_edges(bow), lifted)
    np.testing.assert_allclose(out[0], [0, 0, 0.1], atol=1e-12)


def test_no_face_is_flipped():
    for seed in range(5):
        rough = noisy(SHEET, 0.5, seed=seed)
        moved = cn.denoise(rough, **METHOD)
        out = smoothed_boundary(rough, boundary_edges(rough), moved.vertices)
        assert ((rough.moved(out).area_vectors * moved.area_vectors).sum(axis=1) >= 0).all()


def test_the_control_selects_how_the_boundary_moves():
    rough, loop = noisy(SHEET, 0.1, seed=4), on_boundary(SHEET)
    free, smooth, fixed = (cn.denoise(rough, **METHOD, boundary=b).vertices for b in ("free", "smooth", "fixed"))
    assert free.tobytes() == cn.denoise(rough, **METHOD).vertices.tobytes()
    np.testing.assert_allclose(smooth, smoothed_boundary(rough, boundary_edges(rough), free), atol=1e-12)
    assert fixed[loop].tobytes() == rough.vertices[loop].tobytes()
    np.testing.assert_array_equal(fixed[~loop], free[~loop])
    with pytest.raises(cn.ParameterError, match="boundary is 'open'; it must be one of free, smooth, fixed"):
        cn.denoise(rough, **METHOD, boundary="open")


def test_a_flow_with_a_fixed_boundary_converges_to_the_plane_through_it():
    dome = SHEET.moved(SHEET.vertices + np.where(on_boundary(SHEET), 0, 1)[:, None] * (0, 0, 1))
    out = cn.denoise(dome, method="laplacian", iterations=2000, boundary="fixed").vertices
    np.testing.assert_allclose(out[:, 2], 0, atol=1e-3)
    np.testing.assert_array_equal(out[on_boundary(SHEET)], dome.vertices[on_boundary(SHEET)])
