"""A faired region solves the equation of its order, and the vertices around it keep their bits."""

import numpy as np
import pytest
from flows import cylinder
from scipy.optimize import brentq
from shapes import cube, grid, icosphere, noisy

from cascadenorm.baselines.fairing import fairing
from cascadenorm.errors import ParameterError
from cascadenorm.geometry.fairing import fair
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.geometry.neighborhoods import steps_from
from cascadenorm.mesh import Mesh

PLANE = grid(24, 24)
X, Y, _ = PLANE.vertices.T / 24
REGION = (abs(X - 0.5) < 0.3) & (abs(Y - 0.5) < 0.3)
HEIGHT = 1e-4  # so low that the operators are those of the plane


def over_the_plane(z):
    return PLANE.moved(PLANE.vertices + HEIGHT * z[:, None] * (0, 0, 1))


def solved(z, **settings):
    return fairing(over_the_plane(np.where(REGION, 0.3, z)), region=REGION, **settings)[:, 2] / HEIGHT


@pytest.mark.parametrize(
    "order, kept, changed",
    [
        (1, X + 2 * Y - X * Y, X**2 + Y**2),  # harmonic; not
        (2, X**2 + Y**2 - X**3, X**4 + Y**4),  # biharmonic; not
        (3, X**4 + Y**4 - X**5, X**6 + Y**6),  # triharmonic; not
    ],
    ids=["membrane", "thin plate", "minimum variation"],
)
def test_polynomials_in_the_kernel_come_back_exactly_and_others_do_not(order, kept, changed):
    np.testing.assert_allclose(solved(kept, order=order), kept, rtol=0, atol=1e-6)
    assert abs(solved(changed, order=order) - changed).max() > 1e-4


def test_each_solution_has_the_least_energy_of_its_own_order():
    z = np.sin(3 * X) * np.cos(2 * Y)
    laplacian = cotangent_laplacian(PLANE)
    solutions = [solved(z, order=order, iterations=1) for order in (1, 2, 3)]
    for order in (1, 2, 3):
        power = laplacian.power(order)
        energies = [u @ power @ u for u in solutions]
        assert np.argmin(energies) == order - 1


def test_membrane_between_two_rings_becomes_the_catenoid():
    tube, radius = cylinder(60, 10)
    height = 5
    moved = fairing(tube, region=abs(tube.vertices[:, 2] - height) < height - 0.5, order=1, iterations=30)
    neck = brentq(lambda c: c * np.cosh(height / c) - radius, height / 1.19, radius)
    expected = neck * np.cosh((moved[:, 2] - height) / neck)
    assert np.linalg.norm(moved[:, :2], axis=1) == pytest.approx(expected, rel=0.005)
    assert neck < 0.85 * radius


def test_thin_plate_continues_a_sphere_where_a_membrane_flattens_it():
    sphere = icosphere(3)
    cap = sphere.vertices[:, 2] > 0.8
    flat = sphere.moved(np.where(cap[:, None], (0, 0, 0.8) + 0.9 * sphere.vertices * (1, 1, 0), sphere.vertices))
    radii = [np.linalg.norm(fairing(flat, region=cap, order=order, iterations=10)[cap], axis=1) for order in (1, 2, 3)]
    assert radii[0].min() < 0.9
    assert radii[1] == pytest.approx(1, abs=0.02)
    assert radii[2] == pytest.approx(1, abs=0.01)


def test_vertices_around_keep_their_bits_and_lone_ones_too():
    rough = noisy(icosphere(2), 0.2)
    lone = Mesh(np.concatenate([rough.vertices, [[5, 5, 5]]]), rough.faces)
    region = lone.vertices[:, 2] > 0.3
    region[-1] = True
    for order in (1, 2, 3):
        for weights in ("cotan", "uniform"):
            moved = fairing(lone, region=region, order=order, weights=weights)
            assert (moved[~region] == lone.vertices[~region]).all()
            assert (moved[-1] == lone.vertices[-1]).all()
            assert (moved[:-1][region[:-1]] != lone.vertices[:-1][region[:-1]]).any()
    assert (fairing(lone, region=np.zeros(163, bool)) == lone.vertices).all()


def test_a_free_boundary_is_allowed():
    region = X > 0.6
    bent = over_the_plane(np.sin(5 * Y))
    for order in (1, 2, 3):
        assert abs(fairing(bent, region=region, order=order)).max() < 30


def test_what_nothing_holds_is_refused():
    sphere = icosphere(1)
    two = Mesh(
        np.concatenate([sphere.vertices, sphere.vertices + 5]), np.concatenate([sphere.faces, sphere.faces + 42])
    )
    with pytest.raises(ParameterError, match="needs a region"):
        fairing(sphere)
    with pytest.raises(ParameterError, match=r"whole connected components.*42 vertices: 42, 43, 44"):
        fairing(two, region=np.arange(84) >= 42)


def test_a_fair_seam_rounds_the_edges_of_a_cube_and_nothing_else():
    box = cube(12)
    seam = (abs(box.vertices) > 1 - 1e-9).sum(axis=1) > 1
    region = steps_from(box.topology, seam, 2) <= 2
    moved, away = fair(box, region), ~region
    assert (moved[away] == box.vertices[away]).all()
    turn = [
        np.linalg.norm(
            np.diff(mesh.face_normals[mesh.topology.edge_faces.indices.reshape(-1, 2)], axis=1), axis=2
        ).max()
        for mesh in (box, box.moved(moved))
    ]
    assert turn[1] < 0.75 * turn[0]
