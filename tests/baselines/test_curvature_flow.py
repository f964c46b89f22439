import numpy as np
import pytest
from shapes import icosphere, noisy

from cascadenorm.baselines.curvature_flow import mean_curvature_flow
from cascadenorm.baselines.diffusion import laplacian
from cascadenorm.mesh import Mesh


@pytest.mark.parametrize("scheme", ["implicit", "explicit"])
def test_radius_of_a_sphere_follows_its_law(scheme):
    sphere = icosphere(4)
    start = sphere.moved(2 * sphere.vertices)
    steps = 80
    time = 1 / 2  # r² = 4 - 4t = 2
    step = time / steps / start.mean_edge_length**2
    shrunk = mean_curvature_flow(start, step=step, iterations=steps, scheme=scheme)
    radius = np.linalg.norm(shrunk, axis=1)
    assert radius.mean() == pytest.approx(np.sqrt(2), rel=0.01)
    assert np.ptp(radius) < 0.01


def test_one_step_is_a_step_with_the_laplacian_of_the_input():
    mesh = noisy(icosphere(2), 0.2)
    settings = {"step": 0.3, "iterations": 1, "scheme": "implicit"}
    expected = laplacian(mesh, weights="cotan", **settings)
    np.testing.assert_allclose(mean_curvature_flow(mesh, **settings), expected, atol=1e-12)


def test_two_steps_rebuild_the_laplacian():
    mesh = noisy(icosphere(2), 0.2)
    first = mesh.moved(mean_curvature_flow(mesh, step=0.3, iterations=1))
    ratio = (mesh.mean_edge_length / first.mean_edge_length) ** 2
    expected = mean_curvature_flow(first, step=0.3 * ratio, iterations=1)
    np.testing.assert_allclose(mean_curvature_flow(mesh, step=0.3, iterations=2), expected, atol=1e-9)


def test_a_flat_disk_with_its_boundary_held_stays():
    disk = Mesh([(0.1, 0.2, 0), (1, 0, 0), (0, 1, 0), (-1, -1, 0)], [(0, 1, 2), (0, 2, 3), (0, 3, 1)])
    moved = mean_curvature_flow(disk, step=1.0, iterations=5, region=np.array([True, False, False, False]))
    np.testing.assert_allclose(moved, disk.vertices, atol=1e-12)
