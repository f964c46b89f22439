"""Every tessellation is closed, of about the wanted size, and has the creases of the shape."""

import numpy as np
import pytest
from distance_fields import CUBE, HALF, TURN

from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import Tessellation, shape_creases, tessellate
from cascadenorm.data_gen.shapes import fields, placement


def test_creases_of_a_tessellated_cube_are_its_twelve_edges():
    rng = np.random.default_rng(2)
    mesh = tessellate(CUBE, extent_of(CUBE, rng=rng), faces=3000, sharp=True, tessellation="even", rng=rng)
    ends = mesh.vertices[mesh.topology.edges[shape_creases(CUBE, mesh)]]
    assert (np.isclose(np.abs(ends @ TURN), HALF, atol=1e-4).sum(axis=2) >= 2).mean() > 0.99
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(8 * HALF.sum(), rel=0.03)


@pytest.mark.parametrize("tessellation", Tessellation.__args__)
@pytest.mark.parametrize("sharp", [True, False])
def test_every_tessellation_makes_closed_meshes_of_about_the_wanted_size(tessellation, sharp):
    field = fields.difference(CUBE, placement.moved(fields.cylinder(radius=0.3, half_height=2.0), rotation=TURN))
    rng = np.random.default_rng(3)
    extent = extent_of(field, rng=rng)
    mesh = tessellate(field, extent, faces=6000, sharp=sharp, tessellation=tessellation, rng=rng)
    assert is_manifold(mesh)
    assert (mesh.topology.edge_faces.counts == 2).all()
    assert 4000 < len(mesh.faces) < 9000
    assert mesh.areas.min() > 0
    assert np.abs(field(mesh.vertices)).mean() < 0.02
