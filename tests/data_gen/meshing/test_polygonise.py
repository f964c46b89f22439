"""Polygonisers converge, are exact on flat faces and give surfaces that face outward."""

import numpy as np
import pytest
from distance_fields import CUBE, HALF, TURN, lattice_of

from cascadenorm.data_gen.meshing.polygonise import dual_contouring, marching_cubes
from cascadenorm.data_gen.meshing.surface import untangled
from cascadenorm.data_gen.shapes import fields


def test_marching_cubes_on_the_sphere_converges_at_second_order():
    steps = np.array([0.2, 0.1, 0.05])
    error = [4 / 3 * np.pi - marching_cubes(s := fields.sphere(radius=1), lattice_of(s, h)).volume for h in steps]
    assert min(error) > 0
    assert np.polyfit(np.log(steps), np.log(error), 1)[0] == pytest.approx(2, abs=0.15)


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_dual_contouring_of_a_cube_has_six_flat_sides_and_straight_edges(jitter):
    mesh = untangled(dual_contouring(CUBE, lattice_of(CUBE, 0.07, jitter=jitter)))
    local = mesh.vertices @ TURN
    on_sides = np.isclose(np.abs(local), HALF, atol=1e-6)
    assert on_sides.any(axis=1).mean() > 0.99  # all vertices are on a side
    assert np.abs(CUBE(mesh.vertices)).max() < 0.02
    assert mesh.volume == pytest.approx(8 * HALF.prod(), rel=2e-4)
    sides = np.abs(mesh.face_normals @ TURN).max(axis=1)
    assert mesh.areas[sides > 1 - 1e-9].sum() > 0.99 * mesh.area  # and nearly all the area is flat
    on_edges = on_sides.sum(axis=1) == 2
    length = 8 * HALF.sum()
    assert on_edges.sum() > 0.7 * length / 0.07
    assert (on_sides.sum(axis=1) == 3).sum() >= 7


def test_orientation_is_outward_for_holes_too():
    hollow = fields.shell(fields.sphere(radius=0.9), thickness=0.4)
    for polygonise in (marching_cubes, dual_contouring):
        mesh = polygonise(hollow, lattice_of(hollow, 0.08, jitter=0.2))
        assert mesh.volume == pytest.approx(4 / 3 * np.pi * (1.1**3 - 0.7**3), rel=0.02)
