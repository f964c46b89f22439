import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.controls.boundary import along_the_rim, rim_of
from cascadenorm.mesh import Mesh, unit

SHEET = grid(12, 12)
METHOD = {"method": "bilateral-normal"}


def disc(sides: int) -> Mesh:
    angles = np.arange(sides) * 2 * np.pi / sides
    rim = np.stack([np.cos(angles), np.sin(angles), 0.3 * np.ones(sides)], axis=1)
    faces = [(sides, i, (i + 1) % sides) for i in range(sides)]
    return Mesh(np.concatenate([rim, [[0, 0, 0]]]), faces)


def on_the_rim(mesh: Mesh) -> np.ndarray:
    return mesh.topology.boundary_vertices


def off_the_square(vertices: np.ndarray) -> float:
    """Root mean square distance of the sheet's rim from the square it was, in the plane."""
    x, y = vertices[on_the_rim(SHEET), :2].T
    return float(np.sqrt((np.min(np.abs([x, x - 12, y, y - 12]), axis=0) ** 2).mean()))


def test_a_rim_runs_once_around_as_its_faces_do():
    rim = rim_of(SHEET)
    np.testing.assert_array_equal(rim.vertices, np.flatnonzero(on_the_rim(SHEET)))
    edge, seen = 0, set()
    for _ in range(48):
        seen.add(edge)
        assert rim.edges[edge, 1] == rim.edges[rim.onward[edge, 1], 0] and rim.signs[edge, 1] == 1
        edge = int(rim.onward[edge, 1])
    assert edge == 0 and len(seen) == 48


def test_a_face_that_names_a_vertex_twice_makes_no_rim():
    mesh = Mesh(cube(2).vertices, np.concatenate([cube(2).faces, [[0, 0, 0]]]))
    assert not len(rim_of(mesh).edges)


@pytest.mark.parametrize("mesh", [disc(30), SHEET, icosphere(1)], ids=["circle", "square", "closed"])
def test_circles_squares_and_closed_meshes_stay(mesh):
    out = along_the_rim(mesh, rim_of(mesh), mesh.vertices)
    np.testing.assert_allclose(out, mesh.vertices, rtol=0, atol=1e-12)


@pytest.mark.parametrize("level", [0.05, 0.1, 0.2])
def test_jaggedness_goes_and_corners_stay(level):
    rough = noisy(SHEET, level, seed=1)
    out = along_the_rim(rough, rim_of(rough), rough.vertices)
    assert off_the_square(out) < 0.5 * off_the_square(rough.vertices)
    corners = [0, 12, 13 * 12, 13 * 13 - 1]
    assert np.linalg.norm(out[corners] - SHEET.vertices[corners], axis=1).max() < 4 * level


def test_off_the_surface_vertices_go_where_the_method_moved_them():
    rough = noisy(SHEET, 0.1, seed=2)
    moved = cn.denoise(rough, **METHOD).vertices
    out = along_the_rim(rough, rim_of(rough), moved)
    rim = on_the_rim(SHEET)
    around = [np.bincount(rough.faces.ravel(), np.repeat(a, 3)) for a in rough.moved(moved).area_vectors.T]
    normals = unit(np.stack(around, axis=1))
    np.testing.assert_allclose(((out - moved) * normals)[rim].sum(axis=1), 0, atol=1e-12)
    assert np.linalg.norm(out - moved, axis=1)[rim].mean() > 0.02
    np.testing.assert_array_equal(out[~rim], moved[~rim])


def test_the_direction_in_which_faces_run_does_not_matter():
    rough = noisy(SHEET, 0.1, seed=3)
    flip = np.random.default_rng(0).random(len(SHEET.faces)) < 0.5
    mixed = Mesh(rough.vertices, np.where(flip[:, None], rough.faces[:, ::-1], rough.faces))
    plain, other = (along_the_rim(m.moved(m.vertices * (1, 1, 0)), rim_of(m), m.vertices) for m in (rough, mixed))
    inside = np.bincount(SHEET.faces[flip].ravel(), minlength=169) == 0  # normals of the others differ
    np.testing.assert_allclose(other[inside], plain[inside], atol=1e-12)


def test_where_rims_touch_a_vertex_moves_off_the_surface_alone():
    bow = Mesh([[0, 0, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0]], [[0, 2, 1], [0, 4, 3]])
    lifted = bow.vertices + np.array([0.3, 0.2, 0.1])
    out = along_the_rim(bow, rim_of(bow), lifted)
    np.testing.assert_allclose(out[0], [0, 0, 0.1], atol=1e-12)


def test_no_face_turns_over():
    for seed in range(5):
        rough = noisy(SHEET, 0.5, seed=seed)
        moved = cn.denoise(rough, **METHOD)
        out = along_the_rim(rough, rim_of(rough), moved.vertices)
        assert ((rough.moved(out).area_vectors * moved.area_vectors).sum(axis=1) >= 0).all()


def test_boundary_says_what_becomes_of_the_rim():
    rough, rim = noisy(SHEET, 0.1, seed=4), on_the_rim(SHEET)
    free, smooth, fixed = (cn.denoise(rough, **METHOD, boundary=b).vertices for b in ("free", "smooth", "fixed"))
    assert free.tobytes() == cn.denoise(rough, **METHOD).vertices.tobytes()
    np.testing.assert_allclose(smooth, along_the_rim(rough, rim_of(rough), free), atol=1e-12)
    assert fixed[rim].tobytes() == rough.vertices[rim].tobytes()
    np.testing.assert_array_equal(fixed[~rim], free[~rim])
    with pytest.raises(cn.ParameterError, match="boundary is 'open'; it must be one of free, smooth, fixed"):
        cn.denoise(rough, **METHOD, boundary="open")


def test_a_fixed_rim_holds_the_surface_of_a_flow():
    dome = SHEET.moved(SHEET.vertices + np.where(on_the_rim(SHEET), 0, 1)[:, None] * (0, 0, 1))
    out = cn.denoise(dome, method="laplacian", iterations=2000, boundary="fixed").vertices
    np.testing.assert_allclose(out[:, 2], 0, atol=1e-3)
    np.testing.assert_array_equal(out[on_the_rim(SHEET)], dome.vertices[on_the_rim(SHEET)])
