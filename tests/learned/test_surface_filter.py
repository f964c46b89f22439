"""Measured surfaces, and no others, are filtered after the network, and more so near the boundary of a view."""

from functools import partial

import numpy as np
from shapes import grid, icosphere, noisy
from test_gate import side_by_side

import cascadenorm as cn
from cascadenorm.baselines.bilateral_normal import bilateral_normals
from cascadenorm.geometry.fairing import grown
from cascadenorm.learned import surface_filter
from cascadenorm.learned.surface_filter import with_filtered_surfaces
from cascadenorm.mesh import Bools, Mesh, Vectors


def tilt(mesh: Mesh, vertices: Vectors, faces: Bools) -> float:
    """Return the mean angle, in degrees, between some faces and the horizontal plane."""
    return float(np.degrees(np.arccos(np.abs(mesh.moved(vertices).face_normals[faces, 2]))).mean())


def test_noise_on_a_measured_surface_is_reduced_most_at_its_boundary():
    sheet = noisy(grid(40, 40), 0.1)
    filtered = with_filtered_surfaces(sheet, np.ones(len(sheet.faces), bool))
    outer = sheet.topology.boundary_vertices[sheet.faces].any(axis=1)
    inside = (np.abs(sheet.vertices[sheet.faces][..., :2] - 20) < 8).all(axis=(1, 2))
    left = {
        name: tilt(sheet, filtered, faces) / tilt(sheet, sheet.vertices, faces)
        for name, faces in {"boundary": outer, "inside": inside}.items()
    }
    once = cn.denoise(sheet, method="bilateral-normal", sigma_s=0.5, iterations=1).vertices
    np.testing.assert_allclose(tilt(sheet, filtered, inside), tilt(sheet, once, inside), rtol=1e-6)
    assert tilt(sheet, filtered, outer) < 0.95 * tilt(sheet, once, outer)
    assert max(left.values()) < 0.9


def test_a_surface_that_curves_away_at_its_boundary_is_not_flattened_there():
    """Bilateral passes alone leave 2.05°."""
    flat = grid(40, 40)
    x, y, _ = flat.vertices.T
    turn = 0.05 * (x - 20)
    true = flat.moved(np.stack([20 * np.sin(turn), y, 20 * np.cos(turn)], axis=1))
    filtered = with_filtered_surfaces(noisy(true, 0.08), np.ones(len(true.faces), bool))
    edge = true.topology.boundary_vertices[true.faces].any(axis=1)
    cosines = np.einsum("ij,ij->i", true.moved(filtered).face_normals, true.face_normals)[edge]
    assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean() < 1.8


def test_faces_that_are_not_measured_keep_their_bits():
    both = side_by_side(noisy(icosphere(3), 0.1), noisy(grid(8, 8), 0.1))
    measured = both.topology.face_components == both.topology.face_components[-1]
    filtered = with_filtered_surfaces(both, measured)
    own = np.unique(both.faces[measured])
    moved = np.flatnonzero((filtered != both.vertices).any(axis=1))
    assert len(moved) > 0 and np.isin(moved, own).all()
    none = np.zeros(len(both.faces), bool)
    assert with_filtered_surfaces(both, none).tobytes() == both.vertices.tobytes()


def test_surfaces_of_unknown_origin_are_not_filtered():
    """Coarse copies and cut meshes use the network for surfaces alone."""
    sheet = noisy(grid(12, 12), 0.1)
    unknown = cn.denoise(sheet, treat_as="unknown").vertices
    measured = cn.denoise(sheet, treat_as="measured-surface").vertices
    vertex = cn.denoise(sheet, treat_as="vertex-noise").vertices
    assert not np.allclose(unknown, measured) and not np.allclose(unknown, vertex)
    everything = np.ones(len(sheet.faces), bool)
    assert tilt(sheet, measured, everything) < tilt(sheet, unknown, everything)


def test_passes_near_the_boundary_equal_passes_over_the_whole_mesh(monkeypatch):
    """They run on a strip of faces, which has all faces that matter to those near the boundary."""
    sheet = noisy(grid(30, 30), 0.1)
    filtered = partial(bilateral_normals, sigma_s=surface_filter.SIGMA_S, sigma_r=surface_filter.SIGMA_R)
    seen: list[Vectors] = []
    monkeypatch.setattr(surface_filter, "_with_quadrics", lambda _, normals, *__: seen.append(normals) or normals)
    with_filtered_surfaces(sheet, np.ones(len(sheet.faces), bool))
    near = grown(sheet, sheet.topology.boundary_vertices, rings=surface_filter.BOUNDARY_RINGS)[sheet.faces].any(axis=1)
    expected = filtered(sheet, iterations=1)
    expected[near] = filtered(sheet, iterations=surface_filter.BOUNDARY_PASSES)[near]
    assert 0 < near.sum() < len(near) and seen[0].tobytes() == expected.tobytes()
