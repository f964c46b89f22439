"""Decimation removes faces where they show nothing."""

import pytest
from distance_fields import CUBE, lattice_of

from cascadenorm.data_gen.meshing.decimate import decimate
from cascadenorm.data_gen.meshing.half_edges import half_edges_of, is_manifold, mesh_of
from cascadenorm.data_gen.meshing.polygonise import dual_contouring
from cascadenorm.data_gen.meshing.surface import untangled


def test_decimating_a_cube_loses_nothing_of_it():
    mesh = untangled(dual_contouring(CUBE, lattice_of(CUBE, 0.1)))
    corners = half_edges_of(mesh)
    corners.length[:] = 1.0
    decimate(corners, faces=len(mesh.faces) // 4, evenness=1e-6)
    thinned = mesh_of(corners)
    assert is_manifold(thinned)
    assert len(thinned.faces) < 0.3 * len(mesh.faces)
    assert thinned.volume == pytest.approx(mesh.volume, rel=1e-3)
