"""Measured surfaces, and no others, are filtered after the network, with quadrics at the boundary of a view."""

from functools import reduce

import numpy as np
import pytest
from shapes import grid, icosphere, mean_angle, noisy, side_by_side

import cascadenorm as cn
from cascadenorm.learned.surface_filter import SCAN_PASSES, quadric_normals, with_filtered_surfaces
from cascadenorm.mesh import Bools, Mesh, Vectors, unit


def errors(mesh: Mesh, vertices: Vectors, true: Mesh, faces: Bools) -> float:
    """Return the mean angle, in degrees, between some faces and those of another mesh."""
    cosines = np.einsum("ij,ij->i", mesh.moved(vertices).face_normals, true.face_normals)[faces]
    return float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean())


def arch(sides: int) -> Mesh:
    """A sheet that curves away at two of its sides, seen from one side."""
    flat = grid(sides, sides)
    x, y, _ = flat.vertices.T
    turn = 2 * (x / sides - 0.5)
    return flat.moved(np.stack([sides / 2 * np.sin(turn), y, sides / 2 * np.cos(turn)], axis=1))


def everything(mesh: Mesh) -> Bools:
    return np.ones(len(mesh.faces), bool)


def test_noise_that_the_network_leaves_is_reduced():
    """One pass runs over a result that is far from the input."""
    true = arch(40)
    rough, left = noisy(true, 0.3), noisy(true, 0.1, seed=1)
    filtered = with_filtered_surfaces(rough, left.vertices, everything(true))
    inside = (np.abs(true.vertices[true.faces][..., :2] - (0, 20)) < 8).all(axis=(1, 2))
    once = cn.denoise(left, method="bilateral-normal", sigma_s=0.5, iterations=1).vertices
    np.testing.assert_allclose(errors(true, filtered, true, inside), errors(true, once, true, inside), rtol=1e-6)
    assert errors(true, filtered, true, inside) < 0.5 * errors(true, left.vertices, true, inside)


def test_scans_with_little_noise_are_between_the_network_and_the_filtered_input():
    scan, result = noisy(arch(40), 0.06), noisy(arch(40), 0.04, seed=1)
    inside = (np.abs(scan.vertices[scan.faces][..., :2] - (0, 20)) < 8).all(axis=(1, 2))
    between = with_filtered_surfaces(scan, result.vertices, everything(scan))
    filtered = cn.denoise(scan, method="bilateral-normal", iterations=SCAN_PASSES)
    apart = errors(scan, result.vertices, filtered, inside)
    assert errors(scan, between, filtered, inside) < 0.7 * apart
    assert errors(scan, between, result, inside) < 0.95 * apart


def test_what_the_network_hardly_turns_is_not_filtered():
    sheet = noisy(arch(20), 0.01)
    nearly = noisy(sheet, 0.002, seed=1)
    assert with_filtered_surfaces(sheet, nearly.vertices, everything(sheet)).tobytes() == nearly.vertices.tobytes()


def test_a_surface_that_curves_away_at_its_boundary_is_not_flattened_there():
    """A filter alone leaves 3.4°."""
    true = arch(40)
    left = noisy(true, 0.08)
    edge = true.topology.boundary_vertices[true.faces].any(axis=1)
    filtered = with_filtered_surfaces(noisy(true, 0.3, seed=1), left.vertices, everything(true))
    assert errors(true, filtered, true, edge) < 2.2


def test_faces_that_are_not_measured_keep_their_bits():
    both = side_by_side(noisy(icosphere(3), 0.1), noisy(grid(8, 8), 0.1))
    rough = noisy(both, 0.2, seed=1)
    measured = both.topology.face_components == both.topology.face_components[-1]
    filtered = with_filtered_surfaces(rough, both.vertices, measured)
    moved = np.flatnonzero((filtered != both.vertices).any(axis=1))
    assert len(moved) > 0 and np.isin(moved, np.unique(both.faces[measured])).all()
    none = np.zeros(len(both.faces), bool)
    assert with_filtered_surfaces(rough, both.vertices, none).tobytes() == both.vertices.tobytes()


def test_components_with_equal_edges_are_filtered_as_if_alone():
    """A sheet with little noise, one with more and a closed surface."""
    shapes = [arch(12), arch(12), icosphere(2)]
    shapes = [shape.moved(shape.vertices / shape.mean_edge_length) for shape in shapes]
    inputs = [noisy(shape, level) for shape, level in zip(shapes, (0.05, 0.3, 0.1), strict=True)]
    results = [noisy(shape, level, seed=1) for shape, level in zip(shapes, (0.03, 0.1, 0.05), strict=True)]
    together, left = reduce(side_by_side, inputs), reduce(side_by_side, results)
    filtered = with_filtered_surfaces(together, left.vertices, everything(together))
    moves = np.split(filtered - left.vertices, np.cumsum([len(shape.vertices) for shape in shapes])[:-1])
    for noise, result, move in zip(inputs, results, moves, strict=True):
        alone = with_filtered_surfaces(noise, result.vertices, everything(noise)) - result.vertices
        assert np.linalg.norm(alone) > 0
        assert np.linalg.norm(move - alone) < 0.1 * np.linalg.norm(alone)


def test_surfaces_of_unknown_origin_are_not_filtered():
    """Coarse copies and cut meshes use the network for surfaces alone."""
    true = arch(20)
    sheet = noisy(true, 0.1)
    unknown = cn.denoise(sheet, treat_as="unknown").vertices
    measured = cn.denoise(sheet, treat_as="measured-surface").vertices
    vertex = cn.denoise(sheet, treat_as="vertex-noise").vertices
    assert not np.allclose(unknown, measured) and not np.allclose(unknown, vertex)
    assert mean_angle(sheet.moved(measured), true) < 0.95 * mean_angle(sheet.moved(unknown), true)


def bent(curvature: float) -> tuple[Mesh, Vectors]:
    """Return a sheet z = curvature / 2 (x² - xy) with its true normals at the centroids of its faces, (m, 3)."""
    flat = grid(20, 20)
    x, y = flat.vertices[:, 0] - 10, flat.vertices[:, 1] - 10
    mesh = flat.moved(np.stack([x, y, 0.5 * curvature * (x * x - x * y)], axis=1))
    u, v, _ = mesh.centroids.T
    return mesh, unit(np.stack([-curvature * (u - 0.5 * v), 0.5 * curvature * u, np.ones_like(u)], axis=1))


def angles(first: Vectors, second: Vectors) -> Vectors:
    return np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", first, second), -1, 1)))


@pytest.mark.parametrize("curvature", [0.0, 0.02])
def test_normals_of_a_surface_of_second_order_are_right_up_to_the_boundary(curvature):
    mesh, true = bent(curvature)
    every = np.arange(len(mesh.faces))
    assert angles(quadric_normals(mesh, mesh.face_normals, every), true).max() < 0.2


def test_noise_is_averaged_without_flattening_the_surface():
    mesh, true = bent(0.02)
    rough = noisy(mesh, 0.1)
    edge = np.flatnonzero(mesh.topology.boundary_vertices[mesh.faces].any(axis=1))
    fitted = quadric_normals(rough, mesh.face_normals, edge)
    assert angles(fitted, true[edge]).mean() < 0.5 * angles(rough.face_normals[edge], true[edge]).mean()


def test_few_or_no_faces_keep_what_they_have():
    few = icosphere(0)
    every = np.arange(20)
    np.testing.assert_array_equal(quadric_normals(few, few.face_normals, every), few.face_normals)
    assert quadric_normals(few, few.face_normals, every[:0]).shape == (0, 3)


def test_faces_without_area_have_no_normal_and_no_influence():
    flat = grid(20, 20)
    vertices = flat.vertices.copy()
    vertices[30] = vertices[31]
    mesh = flat.moved(vertices)
    fitted = quadric_normals(mesh, mesh.face_normals, np.arange(len(mesh.faces)))
    assert (mesh.areas == 0).sum() == 2
    np.testing.assert_allclose(fitted, mesh.face_normals, atol=1e-12)


def test_the_other_side_of_an_edge_has_no_influence():
    """The fold of a sheet through 90° keeps the plane on either side."""
    flat = grid(20, 20)
    x, y, _ = flat.vertices.T
    fold = flat.moved(np.stack([np.minimum(x, 10), y, np.maximum(x - 10, 0)], axis=1))
    fitted = quadric_normals(fold, fold.face_normals, np.arange(len(fold.faces)))
    assert angles(fitted, fold.face_normals).max() < 1e-3
