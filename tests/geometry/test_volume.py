"""Closed parts keep their volume, each by itself, by the vertices that may move."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.geometry.volume import closed_parts, is_closed, with_volume_of
from cascadenorm.mesh import Mesh

BALL = noisy(icosphere(2), 0.2)


def test_volume_of_closed_parts_is_kept_each_by_itself():
    parts = [noisy(icosphere(3), 0.1), noisy(cube(6), 0.1)]
    vertices = np.concatenate([parts[0].vertices, parts[1].vertices * 0.3 + 5])
    mesh = Mesh(vertices, np.concatenate([parts[0].faces, parts[1].faces + len(parts[0].vertices)]))
    out = cn.denoise(mesh, method="laplacian", volume="keep").vertices
    cut = len(parts[0].vertices)
    for part, before, after in ((parts[0], vertices[:cut], out[:cut]), (parts[1], vertices[cut:], out[cut:])):
        assert part.moved(after).volume == pytest.approx(part.moved(before).volume, rel=1e-10)
    plain = cn.denoise(mesh, method="laplacian").vertices
    assert parts[0].moved(plain[:cut]).volume < 0.99 * parts[0].volume


def test_keeping_the_volume_is_a_scaling_about_the_centroid():
    plain = cn.denoise(BALL, method="laplacian").vertices
    kept = cn.denoise(BALL, method="laplacian", volume="keep").vertices
    factor = (BALL.volume / BALL.moved(plain).volume) ** (1 / 3)
    center = plain.mean(axis=0)
    np.testing.assert_allclose(kept, center + factor * (plain - center), atol=1e-12)


def test_volume_is_kept_by_the_vertices_that_may_move():
    mask = BALL.vertices[:, 0] > -0.5
    out = cn.denoise(BALL, method="laplacian", volume="keep", mask=mask, fixed=[7]).vertices
    assert BALL.moved(out).volume == pytest.approx(BALL.volume, rel=1e-10)
    assert out[~mask].tobytes() == BALL.vertices[~mask].tobytes()
    assert (out[7] == BALL.vertices[7]).all()


def test_open_flipped_and_flat_parts_are_not_scaled():
    sheet = noisy(grid(4, 4), 0.1)
    flipped = BALL.faces.copy()
    flipped[3] = flipped[3, ::-1]
    for mesh in (sheet, Mesh(BALL.vertices, flipped)):
        assert not is_closed(mesh)
        assert closed_parts(mesh).total == 0
        kept = with_volume_of(mesh, mesh.vertices * 0.9, weights=np.ones(len(mesh.vertices)))
        np.testing.assert_array_equal(kept, mesh.vertices * 0.9)
    flat = icosphere(1).moved(icosphere(1).vertices * (1, 1, 0))
    assert is_closed(flat)
    np.testing.assert_array_equal(with_volume_of(flat, flat.vertices * 2, weights=np.ones(42)), flat.vertices * 2)


def test_volume_is_kept_where_faces_are_flipped_and_where_all_are():
    kept = cn.denoise(BALL, method="laplacian", volume="keep").vertices
    for which in ([3, 50], slice(None)):
        faces = BALL.faces.copy()
        faces[which] = faces[which, ::-1]
        out = cn.denoise(BALL.vertices, faces, method="laplacian", volume="keep")
        assert out.tobytes() == kept.tobytes()
