"""Many bilateral passes, four range spreads side by side, are those of the bilateral filter of normals."""

import numpy as np
from iterated_normals import compact, iterated
from shapes import icosphere, noisy

from cascadenorm.baselines.bilateral_normal import bilateral_normals
from cascadenorm.baselines.iterated_bilateral import LANES, _bilateral_range
from cascadenorm.learned.descriptors import ITERATED_64, ITERATED_SIGMA_R
from cascadenorm.mesh import Mesh, unit

MESH = noisy(icosphere(2), 0.2)


def test_iterated_normals_hold_the_bilateral_filter_after_its_passes():
    stack = iterated(MESH)
    assert stack.shape == (len(MESH.faces), 1 + len(ITERATED_64) * len(ITERATED_SIGMA_R), 3)
    for p, passes in enumerate(ITERATED_64):
        got = stack[:, (p + 1) * len(ITERATED_SIGMA_R)]
        expected = bilateral_normals(MESH, sigma_s=1.0, sigma_r=np.inf, iterations=passes, center="count")
        np.testing.assert_allclose(got, expected, atol=5e-6)
    twin = MESH.face_normals
    for _ in range(4):
        twin = unit((ring_weights(MESH) * compact(twin, 0.35)) @ twin)
    at = 1 + ITERATED_64.index(4) * len(ITERATED_SIGMA_R) + ITERATED_SIGMA_R.index(0.35)
    np.testing.assert_allclose(stack[:, at], twin, atol=1e-5)


def test_filters_side_by_side_are_what_the_plain_code_says():
    rng, rings = np.random.default_rng(0), MESH.topology.face_rings(1)
    normals = unit(rng.normal(size=(len(MESH.faces), LANES, 3))).transpose(0, 2, 1).astype(np.float32)
    given = (np.ascontiguousarray(normals), MESH.areas.astype(np.float32), rings)
    weights, steepness = rng.random(len(rings.indices), np.float32), np.float32([0, 0.1, 1, 10])
    vectors, plain = np.empty((2, *normals.shape), np.float32)
    _bilateral_range(0, len(normals), *given, weights, steepness, vectors)
    getattr(_bilateral_range, "py_func", _bilateral_range)(0, len(normals), *given, weights, steepness, plain)
    np.testing.assert_allclose(vectors, plain, atol=1e-6)


def ring_weights(mesh: Mesh) -> np.ndarray:
    """Area of a face times the Gaussian of its distance, where it is the row's own or touches it, (m, m)."""
    distances = np.linalg.norm(mesh.centroids[:, None] - mesh.centroids, axis=2) / mesh.mean_edge_length
    near = np.eye(len(mesh.faces), dtype=bool)
    near[mesh.topology.face_rings(1).rows, mesh.topology.face_rings(1).indices] = True
    return near * mesh.areas * np.exp(-0.5 * distances**2)
