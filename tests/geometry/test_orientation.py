"""Faces are oriented alike, closed parts outward and open ones as most of their faces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import cube, grid, icosphere, together

from cascadenorm.geometry.orientation import oriented
from cascadenorm.geometry.volume import is_closed
from cascadenorm.mesh import Mesh

BALL = icosphere(2)
SHEET = grid(5, 4)


def flipped(mesh: Mesh, which) -> Mesh:
    faces = mesh.faces.copy()
    faces[which] = faces[which, ::-1]
    return Mesh(mesh.vertices, faces)


@pytest.mark.parametrize("mesh", [BALL, SHEET, flipped(SHEET, slice(None)), cube(2), together(BALL, SHEET)])
def test_what_is_consistently_oriented_is_returned_itself(mesh):
    assert oriented(mesh) is mesh


@given(st.lists(st.booleans(), min_size=len(BALL.faces), max_size=len(BALL.faces)))
@settings(max_examples=30)
def test_a_closed_part_comes_out_the_same_whatever_was_flipped(which):
    np.testing.assert_array_equal(oriented(flipped(BALL, np.array(which))).faces, BALL.faces)


@given(st.sets(st.integers(0, len(SHEET.faces) - 1), max_size=len(SHEET.faces) // 2 - 1))
@settings(max_examples=30)
def test_an_open_part_follows_the_majority(which):
    np.testing.assert_array_equal(oriented(flipped(SHEET, sorted(which))).faces, SHEET.faces)


def test_without_a_majority_the_first_face_decides():
    half = flipped(SHEET, slice(len(SHEET.faces) // 2, None))
    np.testing.assert_array_equal(oriented(half).faces, SHEET.faces)


def test_parts_are_flipped_each_by_itself_however_small_or_far():
    mesh = together(BALL, BALL.moved(BALL.vertices * 1e-9 + 3), SHEET, flipped(SHEET, slice(None)))
    inside_out = flipped(mesh, slice(0, 2 * len(BALL.faces)))
    np.testing.assert_array_equal(oriented(inside_out).faces, mesh.faces)


def test_no_patch_goes_on_across_an_edge_of_three_faces():
    fins = Mesh(np.random.default_rng(0).normal(size=(5, 3)), [[0, 1, 2], [0, 1, 3], [1, 0, 4]])
    assert oriented(fins) is fins
    wings = together(BALL, BALL)
    faces = wings.faces.copy()
    faces[faces == BALL.faces[0, 0] + len(BALL.vertices)] = BALL.faces[0, 0]  # two balls that touch in a vertex
    pinched = Mesh(wings.vertices, faces)
    back = oriented(flipped(pinched, np.arange(len(faces)) % 3 == 0))
    np.testing.assert_array_equal(back.faces, faces)


def test_copies_of_a_face_count_as_one():
    doubled = Mesh(BALL.vertices, np.concatenate([BALL.faces, BALL.faces[:7], BALL.faces[3:9, ::-1]]))
    faces = oriented(doubled).faces
    np.testing.assert_array_equal(faces[: len(BALL.faces)], BALL.faces)
    normals = oriented(doubled).face_normals
    np.testing.assert_allclose(normals[-13:-6], BALL.face_normals[:7])
    np.testing.assert_allclose(normals[-6:], BALL.face_normals[3:9])


def test_faces_that_repeat_a_vertex_neither_join_nor_part_others():
    a, b, _ = BALL.faces[4]
    mesh = Mesh(BALL.vertices, np.concatenate([BALL.faces, [[a, a, b], [b, b, b]]]))
    assert oriented(mesh) is mesh
    np.testing.assert_array_equal(oriented(flipped(mesh, [4, 9])).faces, mesh.faces)


def test_a_moebius_strip_keeps_one_seam():
    angle = np.arange(16) * 2 * np.pi / 16
    middle = np.stack([np.cos(angle), np.sin(angle), 0 * angle])
    arm = 0.3 * np.stack([*(np.cos(angle / 2) * middle[:2]), np.sin(angle / 2)])
    vertices = np.concatenate([middle + arm, middle - arm], axis=1).T
    ring = np.arange(16)
    ahead, low, ahead_low = (ring + 1) % 16, ring + 16, (ring + 1) % 16 + 16
    ahead[-1], ahead_low[-1] = 16, 0
    faces = np.concatenate([np.stack(t, axis=1) for t in ((ring, ahead, low), (ahead, ahead_low, low))])
    strip = oriented(Mesh(vertices, faces))
    assert len(breaks(strip)) == 1
    np.testing.assert_array_equal(oriented(flipped(strip, [5, 11, 12])).faces, strip.faces)


def breaks(mesh: Mesh) -> np.ndarray:
    """Edges whose two faces run through them the same way."""
    sides = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    ways = np.bincount(mesh.topology.face_edges.ravel(), np.sign(sides[:, 1] - sides[:, 0]), len(mesh.topology.edges))
    return np.flatnonzero((mesh.topology.edge_faces.counts == 2) & (ways != 0))


def test_soup_keeps_its_vertices_and_ends_without_breaks():
    rng = np.random.default_rng(1)
    soup = Mesh(BALL.vertices, rng.permuted(BALL.faces, axis=1))
    assert len(breaks(soup)) > 100
    found = oriented(soup)
    assert is_closed(found) and found.volume == pytest.approx(BALL.volume)
    np.testing.assert_array_equal(np.sort(found.faces, axis=1), np.sort(BALL.faces, axis=1))
