"""Noise turns all faces of a neighbourhood; detail that a network takes for noise turns some of them."""

import numpy as np
from shapes import grid, icosphere, noisy, side_by_side

from cascadenorm.learned.methods import shipped
from cascadenorm.learned.noise_evidence import noise_evidence, turning_angles
from cascadenorm.mesh import Mesh, angles_between

BALL = icosphere(4)


def turned(mesh: Mesh, degrees: float, share: float) -> np.ndarray:
    """A share of the faces, drawn at random, turned by an angle, the others by none."""
    return np.where(np.random.default_rng(0).random(len(mesh.faces)) < share, np.radians(degrees), 0.0)


def test_equal_angles_are_evidence_from_a_fifth_of_a_degree():
    for degrees, evidence in (0.2, 1), (0.15, 0.5), (0.1, 0):
        np.testing.assert_allclose(noise_evidence(BALL, turned(BALL, degrees, 1)), evidence, atol=1e-9)


def test_a_few_large_angles_are_no_evidence():
    np.testing.assert_array_equal(noise_evidence(BALL, turned(BALL, 10, 0.02)), 0)


def test_faces_that_are_not_turned_are_no_evidence():
    np.testing.assert_array_equal(noise_evidence(BALL, np.zeros(len(BALL.faces))), 0)


def test_uneven_angles_are_evidence_if_they_are_large_on_average():
    np.testing.assert_array_equal(noise_evidence(BALL, turned(BALL, 40, 0.1)), 1)


def test_each_component_is_judged_by_itself():
    mesh = side_by_side(BALL, grid(30, 30))
    first = np.arange(len(mesh.faces)) < len(BALL.faces)
    evidence = noise_evidence(mesh, np.where(first, turned(mesh, 40, 0.1), turned(mesh, 10, 0.02)))
    assert np.all(evidence[: len(BALL.vertices)] == 1)
    assert np.all(evidence[len(BALL.vertices) :] == 0)


def test_noise_on_a_part_of_a_mesh_is_evidence_there():
    near = BALL.vertices[:, 2] > 0.8
    angles = np.where(near[BALL.faces].all(axis=1), np.radians(4), 0.0)
    evidence = noise_evidence(BALL, angles)
    assert np.all(evidence[BALL.vertices[:, 2] > 0.95] == 1)
    assert np.all(evidence[BALL.vertices[:, 2] < 0] == 0)


def test_faces_turned_further_than_the_noise_explains_are_no_evidence():
    mesh = noisy(BALL, 0.005)
    explained = angles_between(mesh.face_normals, BALL.face_normals)
    assert noise_evidence(mesh, explained, white=True).mean() > 0.99
    assert noise_evidence(mesh, 3 * explained).mean() > 0.99
    assert noise_evidence(mesh, 3 * explained, white=True).max() == 0


def test_noise_on_a_part_is_evidence_although_the_rest_has_less():
    upper = BALL.vertices[:, 2] > 0.5
    mesh = BALL.moved(np.where(upper[:, None], noisy(BALL, 0.05).vertices, BALL.vertices))
    angles = angles_between(mesh.face_normals, BALL.face_normals)
    evidence = noise_evidence(mesh, angles, white=True)
    assert np.degrees(angles.mean()) < 2
    assert evidence[BALL.vertices[:, 2] > 0.7].mean() > 0.9
    assert np.all(evidence[BALL.vertices[:, 2] < 0.3] == 0)


def test_where_the_noise_cannot_be_estimated_the_angles_count():
    mesh = grid(3, 3)
    angles = np.full(len(mesh.faces), np.radians(1.5))
    np.testing.assert_array_equal(noise_evidence(mesh, angles, white=True), 1)


def test_faces_without_area_are_not_turned():
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], [[0, 1, 2], [0, 1, 3]])
    np.testing.assert_allclose(turning_angles(mesh, np.tile([1.0, 0, 0], (2, 1))), [np.pi / 2, 0])


def test_faces_without_area_are_explained_by_any_noise():
    mesh = grid(12, 12)
    mesh = Mesh(mesh.vertices, np.concatenate([mesh.faces, [[0, 1, 2]]]))  # three vertices of a side
    mesh = mesh.moved(mesh.vertices + np.random.default_rng(0).normal(0, 0.005, mesh.vertices.shape) * [0, 0, 1])
    flat = mesh.moved(mesh.vertices * [1, 1, 0])
    for some in mesh, flat:
        assert np.isfinite(noise_evidence(some, turned(some, 1, 1), white=True)).all()


def test_vertices_without_a_face_have_no_evidence_of_their_own():
    mesh = Mesh(np.vstack([BALL.vertices, [[9.0, 9, 9]]]), BALL.faces)
    np.testing.assert_array_equal(noise_evidence(mesh, turned(mesh, 1, 1)), [1.0] * len(BALL.vertices) + [0.0])


def test_slight_noise_is_removed_where_it_is_and_nowhere_else():
    whole, upper = noisy(BALL, 0.05), BALL.vertices[:, 2] > 0
    mesh = BALL.moved(np.where(upper[:, None], whole.vertices, BALL.vertices))
    denoised = BALL.moved(shipped("auto").vertices(mesh))
    error, noise = (angles_between(some.face_normals, BALL.face_normals) for some in (denoised, mesh))
    assert error[upper[BALL.faces].all(axis=1)].mean() < 0.5 * noise[upper[BALL.faces].all(axis=1)].mean()
    assert np.degrees(error[(BALL.vertices[:, 2] < -0.3)[BALL.faces].all(axis=1)].mean()) < 0.1


def test_components_without_noise_stay_bit_for_bit():
    auto, noisy_ball = shipped("auto"), noisy(BALL, 0.2)
    np.testing.assert_array_equal(auto.vertices(BALL), BALL.vertices)
    both = auto.vertices(side_by_side(BALL, noisy_ball))
    np.testing.assert_array_equal(both[: len(BALL.vertices)], BALL.vertices)
    alone = auto.vertices(noisy_ball) + 100
    np.testing.assert_allclose(both[len(BALL.vertices) :], alone, atol=1e-3)
