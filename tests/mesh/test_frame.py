"""Meshes of any size are worked on at about unit size."""

import numpy as np
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.mesh import Mesh

BALL = noisy(icosphere(2), 0.2)
METHOD = {"method": "bilateral-normal"}


def test_enormous_and_tiny_coordinates_are_framed():
    for exponent in (1020, -1040):
        out = cn.denoise(BALL.moved(np.ldexp(BALL.vertices, exponent)), **METHOD).vertices
        assert np.isfinite(out).all()
        np.testing.assert_allclose(np.ldexp(out, -exponent), cn.denoise(BALL, **METHOD).vertices, rtol=0, atol=1e-6)


def test_a_mesh_of_one_point_stays():
    point = Mesh(np.ones((3, 3)), [[0, 1, 2]])
    assert cn.denoise(point, **METHOD).vertices.tobytes() == point.vertices.tobytes()


def test_an_unused_vertex_at_the_other_end_of_all_numbers_does_no_harm():
    vertices = np.vstack([np.ldexp(BALL.vertices, 1020), np.full((1, 3), -1.7e308)])
    out = cn.denoise(vertices, BALL.faces, **METHOD)
    np.testing.assert_allclose(np.ldexp(out[:-1], -1020), cn.denoise(BALL, **METHOD).vertices, atol=1e-12)
    np.testing.assert_array_equal(out[-1], vertices[-1])
