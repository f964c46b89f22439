import numpy as np
from shapes import icosphere

from cascadenorm.mesh import Mesh
from cascadenorm.mesh.topology_kernels import MOST_AROUND


def row(rings, face: int) -> list[int]:
    return rings.indices[rings.indptr[face] : rings.indptr[face + 1]].tolist()


def test_three_faces_at_an_edge_are_no_pair():
    vertices = np.random.default_rng(0).normal(size=(6, 3))
    book = Mesh(vertices, [(0, 1, 2), (1, 0, 3), (0, 1, 4), (1, 2, 5)])
    assert book.topology.face_pairs.tolist() == [[0, 3]]
    assert book.topology.faces_across.tolist() == [[-1, 3, -1], [-1] * 3, [-1] * 3, [0, -1, -1]]


def test_across_and_back():
    sphere = icosphere(2)
    across = sphere.topology.faces_across
    assert (across >= 0).all() and (np.sort(across[across[:, 0]], axis=1) == np.arange(320)[:, None]).any(axis=1).all()
    shared = [set(sphere.faces[f]) & set(sphere.faces[across[f, side]]) for f in range(320) for side in range(3)]
    expected = [{sphere.faces[f, side], sphere.faces[f, (side + 1) % 3]} for f in range(320) for side in range(3)]
    assert shared == expected


def leaves(count: int) -> Mesh:
    """Return faces that all share the edge from vertex 0 to vertex 1, like the leaves of a book."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    around = np.stack([np.cos(angles), np.sin(angles), np.full(count, 0.5)], axis=1)
    corners = np.stack([np.zeros(count), np.ones(count), np.arange(count) + 2], axis=1)
    return Mesh(np.vstack([[[0, 0, 0], [0, 0, 1]], around]), corners.astype(int))


def test_all_faces_around_a_vertex_are_neighbours():
    topology = leaves(MOST_AROUND + 1).topology
    rings = topology.face_rings(1)
    for f in (0, 60, MOST_AROUND):
        assert sorted(row(rings, f)) == sorted(set(range(MOST_AROUND + 1)) - {f})


def test_neighbourhoods_grow_with_the_number_of_faces_on_an_edge_and_not_with_its_square():
    sizes = [len(leaves(count).topology.face_rings(1).indices) for count in (1000, 2000, 4000)]
    assert sizes[0] <= 1000 * 2 * MOST_AROUND
    assert sizes[2] - sizes[1] == 2 * (sizes[1] - sizes[0]) == 2000 * 2 * MOST_AROUND


def test_bounded_neighbourhoods_are_mutual_and_those_of_a_part_of_the_mesh():
    whole = leaves(1000)
    rings = whole.topology.face_rings(1)
    neighbors = [set(row(rings, f)) for f in range(1000)]
    assert neighbors[500] == set(range(500 - MOST_AROUND, 501 + MOST_AROUND)) - {500}
    assert all(f in neighbors[g] for f in range(1000) for g in neighbors[f])

    # the order of the faces is that of the whole mesh, and all neighbours of face 500 are there
    kept = np.array(sorted({3, 90, 900} | neighbors[500] | {500}))
    part = Mesh(whole.vertices, whole.faces[kept]).topology.face_rings(1)
    assert set(kept[row(part, int(np.searchsorted(kept, 500)))]) == neighbors[500]


def test_the_second_ring_is_the_union_of_the_neighbours_of_the_first():
    rings = [leaves(300).topology.face_rings(ring) for ring in (1, 2)]
    first = [set(row(rings[0], f)) for f in range(300)]
    assert set(row(rings[1], 150)) == set().union(*(first[g] for g in first[150])) - {150}


def test_forgetting_adjacent_faces_keeps_the_vertices_around_each_vertex():
    topology = icosphere(2).topology
    rings, across, pairs = topology.face_rings(1), topology.faces_across, topology.face_pairs
    neighbors = topology.vertex_neighbors
    topology.forget_adjacent_faces()
    assert not {"edge_faces", "interior_edges", "face_pairs", "faces_across"} & set(vars(topology))
    assert topology.vertex_neighbors is neighbors
    assert topology.face_rings(1) is not rings
    np.testing.assert_array_equal(topology.face_rings(1).indices, rings.indices)
    np.testing.assert_array_equal(topology.faces_across, across)
    np.testing.assert_array_equal(topology.face_pairs, pairs)
