"""Every method on a few odd faces, alone and under the controls, and what is measured or filled there."""

import numpy as np
import pytest
from shapes import grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.geometry.coarse_copy import coarse_copy
from cascadenorm.geometry.curvature import mean_curvature

BALL = noisy(icosphere(2), 0.15, seed=1)
POINTS = np.random.default_rng(0).normal(size=(30, 3))
ADVERSARIAL_MESHES = {
    "one triangle": (POINTS, [[0, 1, 2]]),
    "three faces at an edge": (POINTS, [[0, 1, 2], [0, 1, 3], [0, 1, 4]]),
    "one face three times": (POINTS, [[0, 1, 2], [0, 1, 2], [0, 2, 1]]),
    "faces that share a vertex": (POINTS, [[0, 1, 2], [0, 3, 4]]),
    "soup": (POINTS, np.random.default_rng(1).integers(0, 30, (60, 3))),
    "no area": (POINTS, [[0, 0, 1], [1, 1, 1]]),
    "on a line": (np.outer(np.arange(5), [1, 1, 1]), [[0, 1, 2], [2, 3, 4]]),
    "in one place": (np.ones((3, 3)), [[0, 1, 2]]),
    "in two places": (np.repeat([[0.0, 0, 0], [1, 2, 3]], 3, axis=0), [[0, 1, 2], [3, 4, 5]]),
    "flat": (grid(3, 3).vertices, grid(3, 3).faces),
    "spike": (np.concatenate([BALL.vertices[:-1], [[1e6, 0, 0]]]), BALL.faces),
}
of_each_mesh = pytest.mark.parametrize(
    "mesh", [pytest.param(name, marks=pytest.mark.compiled if name == "spike" else ()) for name in ADVERSARIAL_MESHES]
)


@of_each_mesh
def test_adversarial_meshes_come_out_finite(name, mesh):
    vertices, faces = ADVERSARIAL_MESHES[mesh]
    out = cn.denoise(vertices, faces, method=name)
    assert out.shape == vertices.shape and np.isfinite(out).all()
    loose = np.setdiff1d(np.arange(len(vertices)), faces)
    np.testing.assert_array_equal(out[loose], vertices[loose])


@pytest.mark.compiled
@of_each_mesh
@pytest.mark.parametrize("method", ["laplacian", "bilateral-normal"])
def test_adversarial_meshes_come_out_finite_under_all_controls(method, mesh):
    vertices, faces = ADVERSARIAL_MESHES[mesh]
    for keep in (0.5, "3 edges", "inf"):
        out = cn.denoise(
            vertices, faces, method=method, boundary="smooth", creases=30, keep_detail=keep, strength=2, volume="keep"
        )
        assert out.shape == vertices.shape and np.isfinite(out).all()


FUNCTIONS = {
    "coarse_copy": lambda mesh: coarse_copy(mesh, 2 * mesh.mean_edge_length),
    "compare": lambda mesh: cn.compare(mesh, mesh),
    "farthest_points": lambda mesh: cn.farthest_points(mesh, 3),
    "fill_holes": cn.fill_holes,
    "geodesic_distances": lambda mesh: cn.geodesic_distances(mesh, 0),
    "inspect": cn.inspect,
    "manifold_harmonics": lambda mesh: cn.manifold_harmonics(mesh, 2),
    "mean_curvature": mean_curvature,
}


@of_each_mesh
@pytest.mark.parametrize("function", FUNCTIONS)
def test_other_functions_give_a_result_or_a_reason(function, mesh):
    try:
        FUNCTIONS[function](cn.Mesh(*ADVERSARIAL_MESHES[mesh]))
    except (cn.MeshError, cn.ParameterError) as error:
        assert mesh != "flat" and len(str(error)) > 20
