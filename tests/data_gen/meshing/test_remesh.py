"""Remeshing evens out the edges of a closed manifold and keeps its volume."""

import numpy as np
import pytest
from distance_fields import lattice_of

from cascadenorm.data_gen.meshing.half_edges import half_edges_of, is_manifold, mesh_of
from cascadenorm.data_gen.meshing.polygonise import marching_cubes
from cascadenorm.data_gen.meshing.remesh import SHORT, collapse_short, flip_edges, slide, split_long
from cascadenorm.data_gen.shapes import fields


@pytest.mark.parametrize("rule", ["valence", "delaunay"])
def test_remeshing_keeps_a_closed_manifold_and_its_volume(rule):
    sphere = fields.sphere(radius=1)
    corners = half_edges_of(marching_cubes(sphere, lattice_of(sphere, 0.1)))
    target = 0.12
    corners.length[:] = target
    for _ in range(5):
        split_long(corners)
        collapse_short(corners, SHORT)
        flip_edges(corners, rule=rule)
        slide(corners, 0.5)
    mesh = mesh_of(corners)
    assert is_manifold(mesh)
    assert (mesh.topology.edge_faces.counts == 2).all()
    assert len(mesh.vertices) - len(mesh.topology.edges) + len(mesh.faces) == 2
    assert mesh.volume == pytest.approx(4 / 3 * np.pi, rel=0.02)
    ends = mesh.vertices[mesh.topology.edges]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert np.mean((length > 0.7 * target) & (length < 4 / 3 * target)) > 0.98
