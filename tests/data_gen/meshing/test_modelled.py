"""Modelled meshes are closed surfaces of subdivided quadrilaterals."""

import numpy as np
import pytest

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing import modelled
from cascadenorm.data_gen.meshing.half_edges import is_manifold

CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
SIDES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def test_a_subdivided_cube_has_the_points_of_catmull_and_clark():
    points, quads = modelled.subdivided(CUBE, SIDES)
    assert quads.shape == (24, 4)
    assert points[:8] == pytest.approx(CUBE * 5 / 9)
    assert np.sort(np.abs(points[8:20]), axis=1) == pytest.approx(np.tile([0, 0.75, 0.75], (12, 1)))
    assert np.sort(np.abs(points[20:]), axis=1) == pytest.approx(np.tile([0, 0, 1], (6, 1)))


@pytest.mark.parametrize("cut", [0, 1])
@pytest.mark.parametrize("seed", range(4))
def test_modelled_meshes_are_oriented_outwards_and_closed_unless_a_plane_cuts_them(seed, cut, monkeypatch):
    monkeypatch.setattr(modelled, "CUT", cut)
    rng = np.random.default_rng(seed)
    while True:
        try:
            mesh = modelled.modelled_mesh(faces=3000, rng=rng)
            break
        except UnfitShapeError:  # boxes that touch along an edge
            continue
    assert is_manifold(mesh)
    assert (mesh.topology.edge_faces.counts == 2).all() == (not cut)
    assert (mesh.topology.balance[mesh.topology.interior_edges] == 0).all()
    assert mesh.volume > 0
    assert 1000 < len(mesh.faces) < 6000
    assert np.ptp(mesh.vertices, axis=0).max() == pytest.approx(1)


def test_a_number_of_faces_that_no_cage_gives_is_refused():
    with pytest.raises(UnfitShapeError, match="no cage"):
        modelled.modelled_mesh(faces=20, rng=np.random.default_rng(0))
