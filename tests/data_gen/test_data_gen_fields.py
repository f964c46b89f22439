"""Distance fields: gradients of unit length, the algebra of sets, and placement."""

import numpy as np
import pytest

from cascadenorm.data_gen import SHAPE_FAMILIES
from cascadenorm.data_gen.meshing.polygonise import gradients
from cascadenorm.data_gen.shapes import fields, patterns, placement, profiles
from cascadenorm.data_gen.shapes.solids import _regular


def points(seed: int, *, count: int = 2000, reach: float = 1.5) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 3))


HEXAGON = np.stack([np.cos(np.arange(6) * np.pi / 3), np.sin(np.arange(6) * np.pi / 3)], axis=1)
EXACT = {
    "sphere": fields.sphere(radius=0.8),
    "box": fields.box([0.5, 0.7, 0.3]),
    "cylinder": fields.cylinder(radius=0.4, half_height=0.6),
    "torus": fields.torus(major=0.8, minor=0.25),
    "tube": fields.tube(points(3, count=7), radius=0.2),
    "polytope": fields.polytope(np.concatenate([np.eye(3), -np.eye(3)]), np.full(6, 0.7)),
    "prism": profiles.extruded(profiles.polygon(HEXAGON), half_height=0.4),
    "lathe": profiles.revolved(profiles.polygon(HEXAGON + np.array([1.5, 0]))),
    "moved": placement.moved(fields.box([0.5, 0.7, 0.3]), by=[0.1, 0.2, 0.3], rotation=np.eye(3)[[1, 2, 0]]),
    "repeated": placement.around(placement.moved(fields.sphere(radius=0.2), by=[0.8, 0, 0]), count=5),
}


@pytest.mark.parametrize("name", EXACT)
def test_distances_have_unit_gradient_almost_everywhere(name):
    slope = np.linalg.norm(gradients(EXACT[name], points(1), step=1e-6), axis=1)
    assert np.mean(np.abs(slope - 1) < 1e-4) > 0.995


@pytest.mark.parametrize("blend", ["sharp", "round", "chamfer"])
def test_intersection_is_the_complement_of_the_union_of_complements(blend):
    a, b = EXACT["box"], EXACT["sphere"]
    union = fields.union(fields.complement(a), fields.complement(b), blend=blend, radius=0.2)
    intersection = fields.intersection(a, b, blend=blend, radius=0.2)
    at = points(2)
    np.testing.assert_array_equal(intersection(at), -union(at))


def test_difference_with_itself_is_empty_and_with_nothing_is_itself():
    a, at = EXACT["box"], points(4)
    assert (fields.difference(a, a)(at) >= 0).all()
    np.testing.assert_array_equal(fields.difference(a)(at), a(at))


@pytest.mark.parametrize("blend", ["round", "chamfer"])
def test_blended_union_adds_material_only_near_both_surfaces(blend):
    a, b, at = EXACT["box"], EXACT["torus"], points(5, count=20000)
    sharp, blended = fields.union(a, b), fields.union(a, b, blend=blend, radius=0.1)
    added = (blended(at) < 0) & (sharp(at) >= 0)
    assert added.any()
    assert (np.maximum(a(at), b(at))[added] <= 0.1 + 1e-12).all()
    assert not ((blended(at) >= 0) & (sharp(at) < 0)).any()


def test_melting_tends_to_the_union_as_the_radius_vanishes():
    a, b, at = EXACT["box"], EXACT["torus"], points(6)
    np.testing.assert_allclose(fields.melted(a, b, radius=1e-9)(at), fields.union(a, b)(at), atol=1e-9)


def test_ellipsoid_and_superquadric_vanish_on_their_surface():
    direction = points(7)
    radii = np.array([0.5, 0.9, 0.7])
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    np.testing.assert_allclose(fields.ellipsoid(radii)(unit * radii), 0, atol=1e-12)
    rays = direction / (np.abs(direction) ** 4).sum(axis=1, keepdims=True) ** 0.25
    np.testing.assert_allclose(fields.superquadric(radii, exponent=4)(rays * radii), 0, atol=1e-7)


def test_bending_keeps_the_middle_and_tends_to_nothing():
    a, at = EXACT["box"], points(8)
    np.testing.assert_allclose(placement.bent(a, curvature=1e-5)(at), a(at), atol=1e-4)
    middle = at * [0, 1, 1]
    np.testing.assert_allclose(placement.bent(a, curvature=0.5)(middle), a(middle), atol=1e-12)


def test_rotations_are_rotations():
    turn = placement.random_rotation(rng=np.random.default_rng(0))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)
    turned = placement.aligned(fields.cylinder(radius=0.1, half_height=2.0), [0, 3, 0])
    assert turned(np.array([[0.0, 1.0, 0.0]]))[0] == pytest.approx(-0.1)


def test_noise_is_continuous_bounded_and_set_by_its_generator():
    at = points(9)
    same = [patterns.noise(wavelength=0.3, octaves=3, rng=np.random.default_rng(s))(at) for s in (1, 1, 2)]
    np.testing.assert_array_equal(same[0], same[1])
    assert not np.allclose(same[0], same[2])
    assert np.abs(same[0]).max() < 3
    assert np.abs(same[0].mean()) < 0.1
    pattern = patterns.noise(wavelength=0.3, rng=np.random.default_rng(1))
    assert np.abs(pattern(at + 1e-7) - pattern(at)).max() < 1e-5


def test_cells_know_the_nearest_two_of_the_scattered_points():
    at = points(10, count=200)
    seed = patterns.seed_of(np.random.default_rng(3))
    cells = np.stack(np.meshgrid(*[np.arange(-4, 4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    drawn = [patterns._hash(*cell, seed) for cell in cells.tolist()]
    scattered = cells + np.array([[h & 1023, h >> 10 & 1023, h >> 20 & 1023] for h in drawn]) / 1024
    first, second = np.sort(np.linalg.norm(at[:, None] - scattered, axis=2), axis=1)[:, :2].T
    bumps, cracks = (
        patterns.cells(wavelength=1.0, kind=kind, rng=np.random.default_rng(3))(at) for kind in ("bumps", "cracks")
    )
    np.testing.assert_allclose(bumps, 1 - 2 * np.minimum(first, 1) ** 2, atol=1e-12)
    np.testing.assert_allclose(cracks, 2 * np.minimum((second - first) / 0.35, 1) - 1, atol=1e-12)


def test_no_drawn_polyhedron_is_regular():
    """All angles between the faces differ; in a regular solid few do, and regular solids serve as test models."""
    for seed in range(12):
        normals = _regular(np.random.default_rng(seed))
        angles = np.degrees(np.arccos((normals @ normals.T)[np.triu_indices(len(normals), 1)]))
        assert len(np.unique(angles.round(4))) > 0.95 * len(angles)


def test_low_poly_meshes_are_closed_and_keep_the_edges_of_a_box():
    made = SHAPE_FAMILIES["low_poly"].make(faces=2000, rng=np.random.default_rng(3))
    assert made.noisy is made.clean and made.clean.topology.edge_faces.counts.max() == 2
