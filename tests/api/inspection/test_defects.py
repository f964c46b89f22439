"""Spikes, folds, slivers and other defects are found where their definitions say."""

import numpy as np
import pytest
from shapes import grid, icosphere, together

from cascadenorm.api.inspection import Found, inspect
from cascadenorm.api.inspection.defects import SPIKE, folded_edges, spikes
from cascadenorm.mesh import Mesh

BALL = icosphere(2)


@pytest.mark.parametrize("pointed", [False, True])
def test_a_vertex_is_a_spike_where_its_angles_add_up_to_little(pointed):
    """Six triangles on a regular hexagon of side 1: each has the angle 2 asin(1 / (2 s)) at the apex, of sides s."""
    turn = np.arange(6) * np.pi / 3
    side = 0.5 / np.sin(SPIKE / 12) * (1.001 if pointed else 0.999)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(6)], axis=1)
    apex = (0, 0, np.sqrt(side**2 - 1))
    faces = [(i, (i + 1) % 6, 6) for i in range(6)]
    for flipped in (faces, [face[::-1] for face in faces]):
        found = spikes(Mesh(np.vstack([ring, apex]), flipped))
        assert found.tolist() == [False] * 6 + [pointed]


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize(("angle", "folded"), [(89.9, False), (90, False), (90.1, True), (179, True)])
def test_an_edge_is_folded_where_the_normals_of_its_faces_are_more_than_a_right_angle_apart(angle, folded, flipped):
    turn = np.radians(angle)
    vertices = [(0, 0, 0), (0, 1, 0), (-1, 0, 0), (np.cos(turn), 0, np.sin(turn))]
    second = (3, 1, 0) if not flipped else (3, 0, 1)
    assert folded_edges(Mesh(vertices, [(0, 1, 2), second])).tolist() == [folded]


def only(mesh: Mesh, name: str) -> Found:
    """The one kind of thing that is found."""
    findings = inspect(mesh).findings
    assert list(findings) == [name]
    return findings[name]


def test_an_edge_of_three_faces():
    fin = Mesh(
        np.concatenate([grid(4, 4).vertices, [[1.5, 1.5, 1]]]), np.concatenate([grid(4, 4).faces, [[6, 12, 25]]])
    )
    assert only(fin, "non_manifold_edges") == Found(1, ((6, 12),))


def test_a_vertex_where_two_surfaces_meet():
    two = together(BALL, BALL.moved(BALL.vertices + np.array([2, 0, 0])))
    right, left = np.argmax(BALL.vertices[:, 0]), 162 + np.argmin(BALL.vertices[:, 0])
    pinched = Mesh(two.vertices, np.where(two.faces == left, right, two.faces))
    findings = inspect(pinched).findings
    assert findings["non_manifold_vertices"] == Found(1, (right,))
    assert set(findings) == {"non_manifold_vertices", "unreferenced", "duplicate_vertices"}
    assert inspect(pinched).genus is None


def test_flipped_faces_and_parts_that_are_inside_out():
    faces = BALL.faces.copy()
    faces[40] = faces[40, ::-1]
    found = only(Mesh(BALL.vertices, faces), "flipped_edges")
    assert found.count == 3 and {v for edge in found.first for v in edge} == set(faces[40].tolist())
    two = together(BALL.moved(BALL.vertices * 3), BALL)
    cavity = Mesh(two.vertices, np.concatenate([two.faces[:320], two.faces[320:, ::-1]]))
    assert only(cavity, "inside_out") == Found(1, (320,))
    assert inspect(cavity).volume == pytest.approx(26 * BALL.volume)


def test_faces_without_area_and_slivers():
    vertices = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0.019, 0], [1, 0.021, 0], [1, 1e-14, 1e-14]]
    found = inspect(np.array(vertices), [[0, 2, 3], [0, 2, 4], [0, 1, 2], [0, 2, 5]])
    assert found.findings["slivers"] == Found(1, (0,))
    assert found.findings["zero_area"] == Found(2, (2, 3))
