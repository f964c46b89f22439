import numpy as np
import reference
from shapes import grid, icosphere, noisy

from cascadenorm.baselines.bilateral_normal_global import bilateral_difference, global_normals
from cascadenorm.mesh import Mesh, unit

ROUGH = noisy(icosphere(2), 0.2)
SPREADS = {"sigma_s": 0.8, "sigma_r": 0.4}


def test_difference_equals_its_formula_and_annihilates_constants():
    difference = bilateral_difference(ROUGH, **SPREADS)
    expected = reference.bilateral_difference(ROUGH, ROUGH.topology.face_rings(1), **SPREADS)
    np.testing.assert_allclose(difference.toarray(), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(difference @ np.ones(len(ROUGH.faces)), 0, atol=1e-12)


def test_solution_equals_that_of_the_dense_system():
    difference = reference.bilateral_difference(ROUGH, ROUGH.topology.face_rings(1), **SPREADS)
    areas = np.diag(ROUGH.areas)
    for fidelity in (0.01, 0.3):
        matrix = (1 - fidelity) * difference.T @ areas @ difference + fidelity * areas
        expected = unit(np.linalg.solve(matrix, fidelity * areas @ ROUGH.face_normals))
        np.testing.assert_allclose(global_normals(ROUGH, **SPREADS, fidelity=fidelity), expected, atol=1e-8)


def test_full_fidelity_is_the_identity():
    np.testing.assert_allclose(global_normals(ROUGH, **SPREADS, fidelity=1), ROUGH.face_normals, atol=1e-10)


def test_faces_without_area_or_neighbours_do_no_harm():
    sheet = grid(3, 3)
    vertices = np.concatenate([sheet.vertices, [[9.0, 9, 9], [10, 9, 9], [9, 10, 9]]])
    dirty = Mesh(vertices, np.concatenate([sheet.faces, [[0, 0, 1], [16, 17, 18]]]))
    normals = global_normals(dirty, **SPREADS, fidelity=0.01)
    np.testing.assert_allclose(normals[dirty.areas > 0], dirty.face_normals[dirty.areas > 0], atol=1e-12)
    assert np.isfinite(normals).all()
