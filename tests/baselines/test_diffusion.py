"""Steps of Laplacian and mean curvature flow scale frequencies as their formulas say, however long they are."""

import logging

import numpy as np
import pytest
from flows import spectrally
from shapes import grid, icosphere, noisy

from cascadenorm.baselines.anisotropic_diffusion import anisotropic_diffusion
from cascadenorm.baselines.diffusion import diffuse, laplacian, mean_curvature_flow
from cascadenorm.errors import ParameterError
from cascadenorm.geometry import sparse_solvers
from cascadenorm.geometry.laplacians import cotangent_laplacian, laplacian_of
from cascadenorm.geometry.sparse_solvers import Factorisation
from cascadenorm.mesh import Mesh
from cascadenorm.registry import find

MESH = noisy(icosphere(2), 0.15)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("weights", ["uniform", "cotan"])
@pytest.mark.parametrize("scheme, step", [("explicit", 1e-4), ("implicit", 0.4)])
@pytest.mark.parametrize("iterations", [1, 3])
def test_eigenvectors_are_scaled_by_the_transfer_function(order, weights, scheme, step, iterations):
    unit = MESH.mean_edge_length if weights == "cotan" else 1
    time = step * unit ** (2 * order)
    transfer = (lambda k: 1 - time * k**order) if scheme == "explicit" else (lambda k: 1 / (1 + time * k**order))
    expected = spectrally(MESH, weights, lambda k: transfer(k) ** iterations)
    found = laplacian(MESH, weights=weights, scheme=scheme, order=order, step=step, iterations=iterations)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("order", [2, 3])
def test_large_systems_of_rings_are_solved_without_their_factorisation(monkeypatch, order):
    settings = {"scheme": "implicit", "order": order, "step": 0.5, "iterations": 2, "weights": "cotan"}
    expected = laplacian(MESH, **settings)
    monkeypatch.setattr(sparse_solvers, "DENSE_LIMIT", 0)
    roots = []
    monkeypatch.setattr(sparse_solvers, "solver", lambda root, at: roots.append(root) or Factorisation(root, at).solve)
    np.testing.assert_allclose(laplacian(MESH, **settings), expected, rtol=0, atol=1e-9)
    assert [root.nnz for root in roots] == [cotangent_laplacian(MESH).stiffness.nnz]


def test_explicit_step_that_would_blow_up_is_cut_and_the_log_says_so(caplog):
    largest = cotangent_laplacian(MESH).largest
    step = 3.5 / (largest * MESH.mean_edge_length**2)  # 2 is stable: two halves of it
    with caplog.at_level(logging.INFO, logger="cascadenorm"):
        found = laplacian(MESH, scheme="explicit", step=step, iterations=3, weights="cotan")
    assert "cut into 2" in caplog.text
    expected = spectrally(MESH, "cotan", lambda k: (1 - 1.75 / largest * k) ** 6)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)


def test_explicit_step_far_too_long_is_refused_with_the_way_out():
    with pytest.raises(ParameterError, match=r"10000 are allowed.*times smaller, or use scheme='implicit'"):
        laplacian(MESH, scheme="explicit", step=1e3, iterations=10, order=2)
    with pytest.raises(ParameterError, match="5 explicit steps of this size need inf stable ones"):
        laplacian(MESH, scheme="explicit", step=1e308, order=3)


@pytest.mark.parametrize(
    "name, value", [("step", -0.1), ("step", "inf"), ("iterations", -1), ("order", 4), ("weights", "mean")]
)
def test_bad_parameters_are_refused(name, value):
    with pytest.raises(ParameterError, match=name):
        find("laplacian")(MESH, **{name: value})


@pytest.mark.parametrize(
    "order, profile",
    [(1, lambda u: 1 - u), (2, lambda u: 1 + u - 5 * u**2 + 3 * u**3)],
    ids=["continuous: a straight line", "tangent: the cubic with the slopes of both sides"],
)
def test_limit_of_the_flow_joins_a_fixed_part(order, profile):
    strip = grid(6, 60)  # held left of x = 20, where it rises to 1 with slope 1/20, and flat at 0 right of x = 40
    x = strip.vertices[:, 0]
    held = np.where(x <= 20, x / 20, 0)
    start = np.stack([x, strip.vertices[:, 1], held], axis=1)
    moves = (x > 20) & (x < 40)
    z = diffuse(cotangent_laplacian(strip), start, time=1e8, iterations=2, order=order, region=moves)[:, 2]
    assert (z[~moves] == held[~moves]).all()
    expected = np.where(moves, profile((x - 20) / 20), held)
    assert abs(z - expected).max() < (1e-4 if order == 1 else 0.12)
    middle = strip.vertices[:, 1] == 3
    slope = np.diff(z[middle & (x >= 19) & (x <= 21)])
    assert (abs(slope[1] - slope[0]) > 0.09) == (order == 1)


def test_vertices_outside_the_region_and_without_a_face_keep_their_bits():
    lone = Mesh(np.concatenate([MESH.vertices, [[9, 9, 9]]]), MESH.faces)
    region = lone.vertices[:, 2] > 0
    for scheme in ("explicit", "implicit"):
        for order in (1, 2):
            moved = laplacian(lone, scheme=scheme, order=order, region=region, step=0.1)
            still = ~region | (np.arange(len(region)) == len(region) - 1)
            assert (moved[still] == lone.vertices[still]).all()
            assert (moved[~still] != lone.vertices[~still]).any(axis=1).all()


def test_no_steps_return_a_copy():
    for settings in ({"iterations": 0}, {"step": 0.0}):
        moved = laplacian(MESH, **settings)
        assert (moved == MESH.vertices).all() and not np.shares_memory(moved, MESH.vertices)


@pytest.mark.compiled
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


@pytest.mark.compiled
@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("weights", ["uniform", "cotan"])
@pytest.mark.parametrize("step", [1e3, 1e15, 1e307])
def test_implicit_steps_of_any_length_keep_the_mean_of_each_component(order, weights, step):
    small = 0.01 * MESH.vertices + (3, 0, 0)
    mesh = Mesh(np.concatenate([MESH.vertices, small]), np.concatenate([MESH.faces, MESH.faces + len(small)]))
    moved = laplacian(mesh, weights=weights, scheme="implicit", order=order, step=step, iterations=3)
    mass = laplacian_of(MESH, weights).mass
    for before, after in zip(np.split(mesh.vertices, 2), np.split(moved, 2), strict=True):
        np.testing.assert_allclose(mass @ after, mass @ before, rtol=0, atol=1e-9 * mass.sum())
        assert np.ptp(after, axis=0).max() < np.ptp(before, axis=0).max()


@pytest.mark.compiled
@pytest.mark.parametrize("flow", [mean_curvature_flow, anisotropic_diffusion])
@pytest.mark.parametrize("step", [1e2, 1e4, 1e20])
def test_a_mesh_that_long_steps_collapse_stays_at_its_place(flow, step):
    mesh = noisy(icosphere(2), 0.2)
    assert abs(flow(mesh, step=step, iterations=6)).max() < 0.1


@pytest.mark.compiled
@pytest.mark.parametrize("flow", [mean_curvature_flow, anisotropic_diffusion])
def test_long_steps_do_not_throw_an_open_sheet_far_away(flow):
    sheet = noisy(grid(10, 12), 0.2)
    assert abs(flow(sheet, step=1e4, iterations=5)).max() < 2 * abs(sheet.vertices).max()


def test_a_flat_disk_with_its_boundary_held_stays():
    disk = Mesh([(0.1, 0.2, 0), (1, 0, 0), (0, 1, 0), (-1, -1, 0)], [(0, 1, 2), (0, 2, 3), (0, 3, 1)])
    moved = mean_curvature_flow(disk, step=1.0, iterations=5, region=np.array([True, False, False, False]))
    np.testing.assert_allclose(moved, disk.vertices, atol=1e-12)
