"""Surfaces that touch themselves are taken apart, and a shape without any is unfit."""

import numpy as np
import pytest

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.surface import extent_of, untangled
from cascadenorm.data_gen.shapes import fields
from cascadenorm.mesh import Mesh


def test_untangling_gives_touching_tetrahedra_vertices_of_their_own():
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    at_a_vertex = Mesh(np.concatenate([corner, -corner[1:]]), np.concatenate([faces, _mirrored(faces, [0, 4, 5, 6])]))
    assert not is_manifold(at_a_vertex)
    apart = untangled(at_a_vertex)
    assert is_manifold(apart)
    assert len(apart.vertices) == 8

    at_an_edge = Mesh(
        np.concatenate([corner, [[0, -1, 0], [0, 0, -1]]]), np.concatenate([faces, _mirrored(faces, [0, 1, 4, 5])])
    )
    assert not is_manifold(at_an_edge)
    apart = untangled(at_an_edge)
    assert is_manifold(apart)
    assert apart.topology.edge_faces.counts.max() == 2
    assert apart.volume > 0


def _mirrored(faces, names):
    """The same tetrahedron over other vertices, after a reflection through the origin or by two axes."""
    faces = np.array(names)[faces]
    return faces[:, ::-1] if names[1] != 1 else faces


def test_an_empty_shape_is_unfit():
    with pytest.raises(UnfitShapeError, match="empty"):
        extent_of(fields.sphere(radius=-1.0), rng=np.random.default_rng(0))
