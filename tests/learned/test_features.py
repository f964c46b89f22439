"""Features depend on the shape around a face alone: on the angles of filtered normals, their means, and open sides."""

import numpy as np
from scipy.spatial.transform import Rotation
from shapes import cube, icosphere, noisy

from cascadenorm.learned.descriptors import guided_descriptor
from cascadenorm.learned.features import (
    CONTEXT_STEPS,
    FLOOR,
    all_pairs,
    component_sums,
    context_features,
    openness,
    pairwise_features,
)
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.averages import averaged_around

MESH = noisy(icosphere(2), 0.2)
TURN = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()


def test_pairwise_features_do_not_see_rotation_scale_or_place():
    turned = Mesh(3 * MESH.vertices @ TURN.T + (5, -2, 9), MESH.faces)
    np.testing.assert_allclose(
        *(np.exp(pairwise_features(guided_descriptor(mesh), all_pairs(18))) for mesh in (turned, MESH)),
        atol=2e-6,
    )


def test_pairwise_features_are_in_order_of_pairs():
    angles = np.array([0.0, 0.3, 1.0])
    stack = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)[None].astype(np.float32)
    np.testing.assert_allclose(
        np.exp(pairwise_features(stack, all_pairs(3)))[0] - FLOOR, 1 - np.cos([0.3, 1.0, 0.7]), atol=1e-6
    )


def test_context_features_are_means_around_vertices_and_over_the_connected_component():
    two = Mesh(
        np.concatenate([MESH.vertices, MESH.vertices + 5]),
        np.concatenate([MESH.faces, MESH.faces[:200] + len(MESH.vertices)]),
    )
    values = np.random.default_rng(0).normal(size=(len(two.faces), 3)).astype(np.float32)
    means = averaged_around(values, two.topology.vertex_faces)
    found = context_features(means, two, component_sums(values, two))

    # after no round the means of the faces around, then of the neighbours, brought to the faces by their corners
    topology = two.topology
    around = [values[topology.vertex_faces.row(i)] for i in range(len(two.vertices))]
    at = np.array([rows.mean(axis=0) if len(rows) else np.zeros(3) for rows in around])
    columns = []
    for rounds in np.diff(CONTEXT_STEPS, prepend=0):
        for _ in range(rounds):
            at = np.array([at[[i, *topology.vertex_neighbors.row(i)]].mean(axis=0) for i in range(len(at))])
        columns.append(at[two.faces].mean(axis=1))
    cut = len(MESH.faces)
    columns.append(np.concatenate([np.broadcast_to(v.mean(axis=0), v.shape) for v in (values[:cut], values[cut:])]))
    rows = np.arange(0, len(values), 7)
    np.testing.assert_allclose(found.of(rows)[:, :-1], np.concatenate(columns, axis=1)[rows], atol=1e-6)
    np.testing.assert_array_equal(found.of(slice(3, 90)), found.of(np.arange(3, 90)))


def test_openness_is_zero_for_a_closed_component_and_one_for_a_flat_sheet():
    closed, sheet = cube(4), Mesh([[0, 0, 3], [9, 0, 3], [9, 9, 3], [0, 9, 3]], [[0, 1, 2], [0, 2, 3]])
    roof = Mesh([[0, 0, 5], [1, 0, 5], [0, 1, 5], [0, 0, 6]], [[0, 2, 1], [0, 1, 3]])  # two unit triangles, upright
    vertices, faces = [closed.vertices], [closed.faces]
    for part in (sheet, roof):
        faces.append(part.faces + sum(len(v) for v in vertices))
        vertices.append(part.vertices)
    mesh = Mesh(np.concatenate(vertices), np.concatenate(faces))
    found = openness(component_sums(np.empty((len(mesh.faces), 0), np.float32), mesh))
    found = found[mesh.topology.face_components]
    expected = [*np.zeros(len(closed.faces)), 1, 1, np.sqrt(0.5), np.sqrt(0.5)]
    np.testing.assert_allclose(found, expected, atol=1e-6)
