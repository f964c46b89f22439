"""A search finds what is near along the surface, and nothing beyond."""

import numpy as np
import pytest
from shapes import grid, icosphere, noisy

from cascadenorm.geometry.neighborhoods import (
    UNLIMITED,
    each_alone,
    faces_near,
    group_search,
    search_group,
    within,
)
from cascadenorm.mesh import Csr, Mesh


def test_finds_all_points_within_the_radius_of_a_connected_mesh():
    mesh = noisy(icosphere(2), 0.1)
    count = len(mesh.vertices)
    radii = np.linspace(0, 3, count)
    distances = np.linalg.norm(mesh.vertices[:, None] - mesh.vertices, axis=2)
    found = within(mesh.vertices, radii, mesh.vertices, mesh.topology.vertex_neighbors, each_alone(count))
    pocket = 0
    for i in range(count):
        near = np.flatnonzero(distances[i] <= radii[i])
        assert set(found.row(i)) <= set(near) and len(found.row(i)) == len(set(found.row(i)))
        pocket += len(near) - len(found.row(i))
    assert found.row(0).tolist() == [0]
    assert pocket < 0.01 * len(found.indices)  # near in space, but only joined by points that are not


@pytest.mark.compiled
def test_finds_at_most_so_many_and_those_of_the_nearest_rings():
    sheet = grid(20, 20)
    count = len(sheet.faces)
    every = np.arange(count, dtype=np.int32)
    whole, few = (faces_near(sheet, every, np.inf, most=most) for most in (count, 9))
    assert (whole.counts == count).all() and (few.counts == 9).all()
    for f in range(count):
        assert few.row(f).tolist() == whole.row(f)[:9].tolist()


def test_does_not_jump_to_another_sheet():
    sheet = grid(4, 4)
    above = sheet.vertices + np.array([0, 0, 0.1])
    both = Mesh(np.concatenate([sheet.vertices, above]), np.concatenate([sheet.faces, sheet.faces + 25]))
    neighbors = both.topology.vertex_neighbors
    found = within(both.vertices, np.full(50, 1.01), both.vertices, neighbors, each_alone(50))
    assert sorted(found.row(12)) == [7, 11, 12, 13, 17]
    seeds = neighbors  # the walk starts around the centre, which it still finds
    assert sorted(within(both.vertices, np.full(50, 1.01), both.vertices, neighbors, seeds).row(12)) == [
        7,
        11,
        12,
        13,
        17,
    ]


def test_faces_are_found_in_the_order_of_the_graph_of_faces_that_share_a_vertex():
    mesh = noisy(icosphere(2), 0.1)
    some, radius = np.arange(0, len(mesh.faces), 7, dtype=np.int32), 2.5 * mesh.mean_edge_length
    graph, seeds = mesh.topology.face_rings(1), Csr(np.arange(len(some) + 1, dtype=np.int64), some)
    expected = within(mesh.centroids[some], np.full(len(some), radius), mesh.centroids, graph, seeds)
    for most in (20, UNLIMITED):
        found = faces_near(mesh, some, radius, most=most)
        for i in range(len(some)):
            assert found.row(i).tolist() == expected.row(i)[:most].tolist()


@pytest.mark.compiled
def test_a_group_of_faces_finds_the_neighbourhood_of_each_member():
    crumpled = noisy(icosphere(3), 0.7)
    around, radius = crumpled.topology.vertex_faces, 2.5 * crumpled.mean_edge_length
    every = np.arange(len(crumpled.faces), dtype=np.int32)
    expected = [set(row) for row in map(faces_near(crumpled, every, radius).row, every)]
    search = group_search(len(crumpled.faces), len(crumpled.vertices), 500)
    several = apart = 0
    for corner in every[::5]:
        touching = np.unique(np.concatenate([around.row(v) for v in crumpled.faces[corner]]))
        distances = np.linalg.norm(crumpled.centroids[touching] - crumpled.centroids[corner], axis=1)
        others = touching[(distances <= radius) & (touching != corner)]
        members = np.array([corner, *others], np.int32)
        spread = distances[np.isin(touching, members)].max()
        count = search_group(members, spread, crumpled.faces, around, crumpled.centroids, radius, search)
        for member, f in enumerate(members):
            found = search.found[:count][(search.reached[:count] >> member) & 1 == 1]
            assert set(found) == expected[f] and len(found) == len(expected[f])
            near = np.linalg.norm(crumpled.centroids - crumpled.centroids[f], axis=1) <= radius
            apart += near.sum() - len(found)
        several += len(members) > 1
    assert several > 100 and apart > 50  # some faces are near in space, but only joined by others that are not


def test_a_group_that_finds_too_many_faces_says_so():
    sheet = grid(20, 20)
    search = group_search(len(sheet.faces), len(sheet.vertices), 50)
    given = np.array([400], np.int32), 0.0, sheet.faces, sheet.topology.vertex_faces, sheet.centroids
    assert search_group(*given, 2.0, search) > 0
    search = group_search(len(sheet.faces), len(sheet.vertices), 50)
    assert search_group(*given, 10.0, search) == -1
