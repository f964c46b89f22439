"""Patches hold all within their halo, and own each vertex and face once."""

import numpy as np
import pytest
from patched import BALL, shuffled

from cascadenorm.geometry.neighborhoods import steps_from
from cascadenorm.geometry.patches.cutting import Cutter


@pytest.mark.parametrize("rings", [0, 1, 5])
def test_patches_hold_all_within_their_halo(rings):
    mesh = shuffled(BALL)
    cutter = Cutter(mesh.vertices, 3)
    owners, inside = np.zeros(len(mesh.faces), int), np.zeros(len(mesh.vertices), int)
    for box in range(cutter.count):
        patch = cutter.patch(mesh, box, rings, {}, None)
        seeds = np.zeros(len(mesh.vertices), bool)
        seeds[patch.vertex_numbers[patch.inside]] = True
        near = steps_from(mesh.topology, seeds, rings) <= rings
        assert (patch.vertex_numbers == np.flatnonzero(near)).all()
        assert (patch.face_numbers == np.flatnonzero(near[mesh.faces].all(axis=1))).all()
        assert (patch.vertex_numbers[patch.corners] == mesh.faces[patch.face_numbers]).all()
        surrounded = steps_from(mesh.topology, ~near, 1) > 1
        assert (patch.complete == surrounded[near]).all()
        owners[patch.face_numbers[patch.own]] += 1
        inside[patch.vertex_numbers[patch.inside]] += 1
        if rings == 5:
            narrow, faces = patch.narrowed(2)
            again = cutter.patch(mesh, box, 2, {}, None)
            assert (narrow.face_numbers == again.face_numbers).all() and (narrow.inside == again.inside).all()
            assert (narrow.complete == again.complete).all() and (narrow.mesh.vertices == again.mesh.vertices).all()
            assert (patch.face_numbers[faces] == again.face_numbers).all()
    assert (owners == 1).all() or rings == 0  # then a face whose corners lie in several boxes is in no patch
    assert (inside == 1).all()


def test_boxes_hold_equally_many_vertices():
    points = np.random.default_rng(0).normal(size=(1000, 3))
    cutter = Cutter(points, 4)
    assert cutter.count == 16 and set(map(len, cutter._boxes)) <= {62, 63}
    assert (np.sort(np.concatenate(cutter._boxes)) == np.arange(1000)).all()
