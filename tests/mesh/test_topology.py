import numpy as np
from shapes import icosphere

from cascadenorm.mesh import Mesh


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
