"""Errors wider than a few edges are removed on a coarse copy, and no edge folds."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes import grid, icosphere, mean_angle, noisy
from terraces import MASK, ball, terraces

import cascadenorm as cn
from cascadenorm.baselines.wide_errors import without_folds, without_wide_errors
from cascadenorm.mesh import Mesh, pair_products, unit

TILT = Rotation.from_euler("xyz", [20, 35, 10], degrees=True).as_matrix()


def box(places: np.ndarray) -> np.ndarray:
    beyond = np.abs(places @ TILT) - (0.65, 0.5, 0.4)
    return np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(axis=-1), 0)


def angle_to_ball(mesh: Mesh) -> float:
    """Mean angle to the sphere under the faces, by area, in degrees."""
    cosines = (mesh.face_normals * unit(mesh.centroids)).sum(axis=1)
    return float(np.degrees(np.arccos(np.clip(cosines, -1, 1))) @ mesh.areas / mesh.area)


STEPPED = terraces(ball, 16, 3)


def test_wider_settings_remove_more_until_the_width_is_reached():
    left = [angle_to_ball(STEPPED)]
    left += [angle_to_ball(cn.denoise(STEPPED, remove_detail=f"{edges} edges")) for edges in (2, 4, 6)]
    assert all(after < before + 0.2 for before, after in pairwise(left))
    assert left[0] > 25 and left[-1] < 6


def test_the_ball_keeps_its_size():
    out = cn.denoise(STEPPED, remove_detail="6 edges")
    assert abs(np.linalg.norm(out.vertices, axis=1).mean() - 0.8) < 0.1 * STEPPED.mean_edge_length


def test_a_method_may_move_all_vertices_to_one_place():
    found = without_wide_errors(icosphere(2), 0.5, lambda copy: np.zeros_like(copy.mesh.vertices))
    np.testing.assert_array_equal(found, 0)


@pytest.mark.parametrize("method", ["bilateral-normal", "taubin", "l0"])
def test_a_classical_method_sees_the_coarse_copy(method):
    plain = angle_to_ball(cn.denoise(STEPPED, method=method))
    assert angle_to_ball(cn.denoise(STEPPED, method=method, remove_detail="6 edges")) < 0.7 * plain


def test_edges_of_a_part_stay_sharp():
    stepped = terraces(box, 20, 3)
    out = cn.denoise(stepped, remove_detail="6 edges")
    cosines = np.abs(out.face_normals @ TILT).max(axis=1)
    flat = np.degrees(np.arccos(np.clip(cosines, -1, 1))) < 15
    assert out.areas[flat].sum() > 0.8 * out.area  # a box rounded by the width of the steps has half of it
    assert np.abs(box(out.vertices)).mean() < 0.5 * np.abs(box(stepped.vertices)).mean()


def folds(mesh: Mesh, degrees: float) -> int:
    """Number of edges at which the surface turns by more than an angle."""
    return int((pair_products(mesh.face_normals, mesh.topology.face_pairs) < np.cos(np.radians(degrees))).sum())


def test_no_edge_is_folded():
    stepped = terraces(box, 20, 3)
    assert folds(stepped, 95) == 0
    assert folds(cn.denoise(stepped, remove_detail="6 edges"), 95) == 0


def test_an_unfolded_mesh_keeps_its_other_vertices():
    mesh = icosphere(4)
    neighbor = mesh.topology.vertex_neighbors.row(500)[0]
    crossed = mesh.vertices.copy()
    crossed[500] += 2 * (crossed[neighbor] - crossed[500])
    assert folds(mesh.moved(crossed), 95) > 0
    out = mesh.moved(without_folds(mesh, crossed))
    assert folds(out, 95) == 0
    moved = np.linalg.norm(mesh.vertices - mesh.vertices[500], axis=1)[(out.vertices != crossed).any(axis=1)]
    assert moved.max() < 4 * mesh.mean_edge_length


def test_edges_of_thin_sheets_stay():
    lens = icosphere(3).moved(icosphere(3).vertices * (1, 1, 0.01))
    assert folds(lens, 95) > 0
    assert without_folds(lens, lens.vertices).tobytes() == lens.vertices.tobytes()


def test_steps_of_an_enlarged_mask_need_no_option():
    asked = cn.denoise(MASK, remove_detail=6 * MASK.mean_edge_length).vertices
    np.testing.assert_allclose(cn.denoise(MASK).vertices, asked, atol=1e-9)
    assert angle_to_ball(cn.denoise(MASK)) < 0.25 * angle_to_ball(MASK)


def test_only_the_enlarged_one_of_two_components_is_copied():
    rough = noisy(icosphere(4), 0.15)
    mesh = Mesh(
        np.concatenate([MASK.vertices, rough.vertices + 5]),
        np.concatenate([MASK.faces, rough.faces + len(MASK.vertices)]),
    )
    out = cn.denoise(mesh)
    first = MASK.moved(out.vertices[: len(MASK.vertices)])
    second = rough.moved(out.vertices[len(MASK.vertices) :])
    assert angle_to_ball(first) < 0.3 * angle_to_ball(MASK)
    assert mean_angle(second, icosphere(4)) < 0.3 * mean_angle(rough, icosphere(4))


@pytest.mark.parametrize("method", ["auto", "bilateral-normal"])
def test_a_coarser_component_does_not_keep_errors_on_a_finer_one(method):
    fine, true = BUMPY, BUMPY.moved(unit(BUMPY.vertices))
    coarse = noisy(icosphere(3), 0.2)
    coarse = coarse.moved(coarse.vertices * 20 + 50)
    both = Mesh(
        np.concatenate([fine.vertices, coarse.vertices]),
        np.concatenate([fine.faces, coarse.faces + len(fine.vertices)]),
    )
    width = 8 * fine.mean_edge_length
    assert width < coarse.mean_edge_length
    vertices = cn.denoise(both, method=method, remove_detail=width).vertices
    found, other = fine.moved(vertices[: len(fine.vertices)]), coarse.moved(vertices[len(fine.vertices) :])
    assert mean_angle(found, true) < 0.3 * mean_angle(fine, true)
    np.testing.assert_allclose(other.vertices, cn.denoise(coarse, method=method).vertices, atol=1e-6)


@pytest.mark.parametrize("width", [0, "1 edge"])
def test_a_width_that_needs_no_copy_leaves_the_method_alone(width):
    asked = cn.denoise(BUMPY, method="taubin", remove_detail=width).vertices
    assert asked.tobytes() == cn.denoise(BUMPY, method="taubin").vertices.tobytes()


def test_work_falls_as_the_width_grows():
    sizes = []
    for edges in (4, 8, 16):
        seen = []
        without_wide_errors(
            BUMPY, edges * BUMPY.mean_edge_length, lambda copy, seen=seen: seen.append(copy) or copy.mesh.vertices
        )
        sizes.append(sum(len(copy.mesh.vertices) for copy in seen))
    assert all(after < 0.35 * before for before, after in pairwise(sizes))


BUMPY = noisy(icosphere(5), 0.2)


def damaged() -> Mesh:
    """An open, a doubled and a tiny component, a face on an edge of two others, and a vertex without a face."""
    sheet, body, tiny = noisy(grid(20, 20), 0.2), noisy(icosphere(3), 0.1), icosphere(0)
    vertices = np.concatenate([sheet.vertices / 10, [[9.0, 9, 9]], body.vertices + 5, 0.01 * tiny.vertices - 3])
    first, second = len(sheet.vertices) + 1, len(sheet.vertices) + 1 + len(body.vertices)
    twice = [body.faces + first, body.faces[:, ::-1] + first]
    fin = [[*sheet.topology.edges[sheet.topology.interior_edges[100]], 5]]
    return Mesh(vertices, np.concatenate([sheet.faces, fin, *twice, tiny.faces + second]))


@pytest.mark.parametrize("width", ["1 edge", "5 edges", "1000 edges", 1e-9, "inf"])
def test_any_mesh_is_denoised_and_vertices_without_a_face_stay(width):
    mesh = damaged()
    out = cn.denoise(mesh, remove_detail=width)
    assert np.isfinite(out.vertices).all()
    assert out.vertices[21 * 21].tolist() == [9.0, 9, 9]
    assert np.linalg.norm(out.vertices - mesh.vertices, axis=1).max() < 2


def test_an_open_sheet_keeps_its_outline():
    sheet = grid(40, 30)
    bumps = 0.8 * np.sin(sheet.vertices[:, 0] * 2 * np.pi / 8) * np.sin(sheet.vertices[:, 1] * 2 * np.pi / 8)
    bumpy = sheet.moved(sheet.vertices + bumps[:, None] * (0, 0, 1))
    out = cn.denoise(bumpy, remove_detail=16).vertices
    assert out[:, 2].std() < 0.35 * bumps.std()
    outline = sheet.topology.boundary_vertices
    assert np.abs(out - sheet.vertices)[outline, :2].mean() < 0.5


def test_other_controls_hold_around_it():
    plain = cn.denoise(STEPPED, remove_detail="6 edges").vertices
    half = cn.denoise(STEPPED, remove_detail="6 edges", strength=0.5).vertices
    np.testing.assert_allclose(half, (plain + STEPPED.vertices) / 2, atol=1e-12)
    fixed = np.arange(0, len(plain), 3)
    held = cn.denoise(STEPPED, remove_detail="6 edges", fixed=fixed, max_displacement=0.01).vertices
    assert held[fixed].tobytes() == STEPPED.vertices[fixed].tobytes()
    assert 0.0099 < np.linalg.norm(held - STEPPED.vertices, axis=1).max() <= 0.01


def test_same_bytes_for_any_number_of_threads():
    one, many = (cn.denoise(STEPPED, remove_detail="6 edges", threads=threads).vertices for threads in (1, 3))
    assert one.tobytes() == many.tobytes()
