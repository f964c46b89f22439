"""Distance fields have gradients of unit length and obey the algebra of sets."""

import numpy as np
import pytest
from distance_fields import EXACT, points

from cascadenorm.data_gen.meshing.polygonise import gradients
from cascadenorm.data_gen.shapes import fields


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
