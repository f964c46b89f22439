"""A filter with more faces in its reach than it may sum over takes the nearest rings."""

import numpy as np
from shapes import grid, noisy, side_by_side

from cascadenorm.baselines.normal_filter_bank import MOST_NEIGHBORS, faces_added, filter_radius, filtered_normals
from cascadenorm.geometry.neighborhoods import faces_near
from cascadenorm.mesh import Mesh, unit


def test_where_tiny_faces_lie_within_a_filter_it_sums_over_the_nearest_rings():
    fine, coarse = noisy(grid(45, 45), 0.2), grid(45, 45)
    mesh = side_by_side(Mesh(0.01 * fine.vertices, fine.faces), coarse)
    guides, spread = mesh.face_normals[None], {"sigma_s": (2.0,), "cutoff": 2.5}
    found = filtered_normals(mesh, guides, sigma_r=(np.inf,), **spread)[:, 0]
    some = np.arange(0, len(fine.faces), 500, dtype=np.int32)
    near = faces_near(mesh, some, filter_radius(mesh, (2.0,), 2.5), most=MOST_NEIGHBORS)
    assert (near.counts == MOST_NEIGHBORS).all() and len(fine.faces) > MOST_NEIGHBORS
    for i, f in enumerate(some):
        g = near.row(i)
        apart = np.linalg.norm(mesh.centroids[g] - mesh.centroids[f], axis=1) / (2 * mesh.mean_edge_length)
        expected = unit((np.exp(-0.5 * apart**2)[:, None] * mesh.area_vectors[g]).sum(axis=0)[None])[0]
        np.testing.assert_allclose(found[f], expected, atol=1e-5)
    one = np.arange(len(mesh.faces)) == some[1]
    assert faces_added(mesh, one, **spread).sum() == MOST_NEIGHBORS
