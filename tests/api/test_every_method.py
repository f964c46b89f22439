"""What holds for every registered method, under the controls that surround it."""

from functools import cache

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.controls.creases import crease_edges
from cascadenorm.mesh import Mesh
from cascadenorm.registry import registered

ROUGH = noisy(icosphere(3), 0.15, seed=1)
MESH = ROUGH.moved(
    np.round(ROUGH.vertices * 2.0**20) / 2.0**14
)  # edges of about 9, few enough bits to be shifted exactly
EDGE = MESH.mean_edge_length
HALF = MESH.vertices[:, 0] > 0
CLEAN_OPEN = Mesh(cube(4).vertices, cube(4).faces[32:])  # a box without its lid
OPEN = noisy(CLEAN_OPEN, 0.1, seed=2)


@cache
def denoised(name: str) -> np.ndarray:
    return cn.denoise(MESH, method=name).vertices


def turn() -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def test_moves_vertices_by_finite_steps_and_leaves_its_input(name):
    before = MESH.vertices.tobytes()
    out = denoised(name)
    assert out.shape == MESH.vertices.shape and np.isfinite(out).all()
    assert 0 < np.linalg.norm(out - MESH.vertices, axis=1).max() < 30 * EDGE
    assert MESH.vertices.tobytes() == before


def test_same_bytes_for_one_and_two_threads(name):
    one, two = (cn.denoise(MESH, method=name, threads=threads).vertices for threads in (1, 2))
    assert one.tobytes() == two.tobytes()


def test_turns_with_the_mesh(name):
    rounding = 1e-5 if name == "cascade" else 1e-6  # the filters of `cascade` weigh normals in single precision
    out = cn.denoise(MESH.moved(MESH.vertices @ turn()), method=name).vertices
    np.testing.assert_allclose(out, denoised(name) @ turn(), rtol=0, atol=rounding * EDGE)


def test_does_not_depend_on_the_order_of_the_faces(name):
    order = np.random.default_rng(2).permutation(len(MESH.faces))
    out = cn.denoise(MESH.vertices, np.roll(MESH.faces[order], 1, axis=1), method=name)
    np.testing.assert_allclose(out, denoised(name), rtol=0, atol=1e-6 * EDGE)


def turned_over(which) -> np.ndarray:
    """The faces of the mesh, some of them the other way round."""
    faces = MESH.faces.copy()
    faces[which] = faces[which, ::-1]
    return faces


def test_faces_may_come_either_way_round(name):
    faces = turned_over(slice(None, None, 3))
    assert cn.denoise(MESH.vertices, faces, method=name).tobytes() == denoised(name).tobytes()


@pytest.mark.parametrize("which", [[0], slice(None), slice(600, None)])
@pytest.mark.parametrize("method", ["taubin", "bilateral-normal", "auto"])
def test_any_faces_may_come_either_way_round(method, which):
    assert cn.denoise(MESH.vertices, turned_over(which), method=method).tobytes() == denoised(method).tobytes()


def test_an_open_mesh_may_show_either_side(name):
    sheet = noisy(grid(9, 9), 0.15)
    out = cn.denoise(sheet, method=name).vertices
    other = cn.denoise(sheet.vertices, sheet.faces[:, ::-1], method=name)
    np.testing.assert_allclose(other, out, rtol=0, atol=1e-6)


def test_a_clean_sheet_stays(name):
    if name in ("laplacian", "taubin", "spectral", "bilateral"):
        pytest.skip("moves the boundary along the surface as well, as published")
    sheet = grid(20, 20)
    np.testing.assert_allclose(cn.denoise(sheet, method=name).vertices, sheet.vertices, rtol=0, atol=1e-9)


@pytest.mark.parametrize("size", [1e-3, 1.0])
def test_debris_beside_a_body_stays_there(name, size):
    debris = noisy(icosphere(1), 0.3, seed=4)
    vertices = np.vstack([MESH.vertices, size * EDGE * debris.vertices + (90, 0, 0)])
    faces = np.vstack([MESH.faces, debris.faces + len(MESH.vertices)])
    moved = cn.denoise(vertices, faces, method=name) - vertices
    assert np.linalg.norm(moved[len(MESH.vertices) :], axis=1).max() < 2 * size * EDGE


COLLAPSING = {
    "anisotropic-diffusion": {},
    "prescribed-mean-curvature": {},
    "mean-curvature-flow": {},
    "l0": {},
    "l0 by cotangents": {"operator": "cotan"},
    "laplacian": {"weights": "cotan", "scheme": "implicit", "order": 3},
}


@pytest.mark.parametrize("kind", ["edge", "short edge", "point", "line"])
@pytest.mark.parametrize("case", COLLAPSING)
def test_collapsed_faces_neither_throw_vertices_nor_take_sides(case, kind):
    vertices, faces = MESH.vertices.copy(), MESH.faces
    for a, b, c in faces[[0, 300, 700, 1100]]:
        if kind == "line":
            vertices[c] = 0.3 * vertices[a] + 0.7 * vertices[b]
        else:
            vertices[b] = vertices[a] + (1e-10 * EDGE if kind == "short edge" else 0)
            vertices[c] = vertices[a] if kind == "point" else vertices[c]
    options = {"method": case.split()[0], **COLLAPSING[case]}
    out = cn.denoise(vertices, faces, **options)
    other = cn.denoise(vertices, np.roll(faces[::-1], 1, axis=1), **options)
    assert np.linalg.norm(out - vertices, axis=1).max() < 3 * EDGE
    if kind != "line" or case in ("anisotropic-diffusion", "laplacian"):  # the normal of a line is rounding
        np.testing.assert_allclose(other, out, rtol=0, atol=1e-4 * EDGE)


def test_scaling_by_a_power_of_two_is_exact(name):
    out = cn.denoise(MESH.moved(MESH.vertices * 2.0**-40), method=name).vertices
    np.testing.assert_array_equal(out, denoised(name) * 2.0**-40)


def test_other_scales_change_nothing_but_rounding(name):
    out = cn.denoise(MESH.moved(MESH.vertices * 1e-8), method=name).vertices
    np.testing.assert_allclose(out, denoised(name) * 1e-8, rtol=0, atol=1e-14 * EDGE)


def test_far_from_the_origin_the_displacement_is_the_same(name):
    offset = np.array([500_000.0, 5_000_000.0, 100.0])
    out = cn.denoise(MESH.moved(MESH.vertices + offset), method=name).vertices
    np.testing.assert_allclose(out - offset, denoised(name), rtol=0, atol=1e-9 * EDGE)


def test_no_strength_or_an_empty_mask_keeps_every_bit(name):
    for nothing in ({"strength": 0}, {"mask": np.zeros(len(HALF), bool)}, {"fixed": np.arange(len(HALF))}):
        assert cn.denoise(MESH, method=name, **nothing).vertices.tobytes() == MESH.vertices.tobytes()


def test_half_strength_goes_half_the_way(name):
    half = cn.denoise(MESH, method=name, strength=0.5).vertices
    np.testing.assert_allclose(half, 0.5 * (MESH.vertices + denoised(name)), rtol=0, atol=1e-12 * EDGE)


def test_strength_two_is_the_method_on_its_own_output_or_removes_detail_from_it(name):
    twice = cn.denoise(MESH, method=name, strength=2).vertices
    if registered()[name].converges:
        left = MESH.moved(denoised(name))
        width = 2 * EDGE / left.mean_edge_length
        again = cn.denoise(left, method="rolling-guidance-normal", width=width).vertices
    else:
        again = cn.denoise(MESH.moved(denoised(name)), method=name).vertices
    np.testing.assert_allclose(twice, again, rtol=0, atol=1e-6 * EDGE)


def test_only_masked_and_free_vertices_move(name):
    fixed = np.flatnonzero(HALF)[:20]
    out = cn.denoise(MESH, method=name, mask=HALF, fixed=fixed).vertices
    still = ~HALF
    still[fixed] = True
    assert out[still].tobytes() == MESH.vertices[still].tobytes()
    assert (out[~still] != MESH.vertices[~still]).any()


@pytest.mark.parametrize("boundary", ["smooth", "fixed"])
def test_all_controls_work_together(name, boundary):
    """On an open box with its edges as creases, partly masked."""
    boundary_vertices = OPEN.topology.boundary_vertices
    weights = np.clip(OPEN.vertices[:, 0] + 0.5, 0, 1)
    inside = OPEN.centroids[:, 1] > -0.9
    options = {
        "strength": 1.5,
        "mask": weights,
        "fixed": [3, 50],
        "only": inside,
        "boundary": boundary,
        "creases": OPEN.topology.edges[crease_edges(CLEAN_OPEN, 45)],
        "keep_detail": "5 edges",
        "remove_detail": "1 edge",
        "volume": "keep",
        "max_displacement": 0.02,
    }
    one, two = (cn.denoise(OPEN, method=name, threads=threads, **options).vertices for threads in (1, 2))
    assert one.tobytes() == two.tobytes()
    still = weights == 0
    still[[3, 50]] = True
    still[OPEN.faces[~inside]] = True
    assert one[still].tobytes() == OPEN.vertices[still].tobytes()
    moves = np.linalg.norm(one - OPEN.vertices, axis=1)
    assert 0 < moves[~boundary_vertices].max() <= 0.02 and moves.max() <= 0.02
    assert (moves[boundary_vertices] > 0).any() == (boundary == "smooth")


def stays_within_limit(dtype: type, method: str) -> bool:
    """Whether a limit holds and is made use of, by vertices that are far enough away to be rounded."""
    vertices = (MESH.vertices + 1000).astype(dtype)
    limit = 0.03 * EDGE
    out = cn.denoise(vertices, MESH.faces, method=method, max_displacement=limit)
    assert out.dtype == dtype
    return 0.5 * limit < np.linalg.norm(out - vertices, axis=1).max() <= limit


def test_no_vertex_goes_beyond_the_limit(name):
    assert stays_within_limit(np.float32, name)


@pytest.mark.parametrize("method", ["taubin", "bilateral-normal", "auto"])
def test_no_vertex_goes_beyond_the_limit_in_double_precision(method):
    assert stays_within_limit(np.float64, method)


def test_unused_vertices_and_faces_without_area_do_no_harm(name):
    strays = np.array([[1e30, -1e30, 0], [np.nextafter(0, 1), -0.0, 3]])
    count = len(MESH.vertices)
    vertices = np.concatenate([MESH.vertices, strays, MESH.vertices[:1]])
    faces = np.concatenate([MESH.faces, [[0, 0, 1], [0, 1, count + 2]]])  # two corners in one vertex, in one place
    out = cn.denoise(Mesh(vertices, faces), method=name).vertices
    assert np.isfinite(out).all()
    assert out[count : count + 2].tobytes() == strays.tobytes()
