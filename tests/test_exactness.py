"""Computed surfaces are told from measured ones: planes that triangles share exactly, off any lattice."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes import cube, grid, icosphere, noisy

from cascadenorm.data_gen.volumes import marching_cubes
from cascadenorm.geometry.exactness import coplanar_neighbors, exact_vertices, lattice_share
from cascadenorm.mesh import Mesh


def cylinder(sides: int, height: float = 2.0) -> Mesh:
    """A closed cylinder as CAD kernels triangulate one: long strips around, fans at both ends."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    vertices = np.concatenate([ring, ring + np.array([0, 0, height])])
    a, b = np.arange(sides), np.roll(np.arange(sides), -1)
    strips = [np.stack([a, b, b + sides], axis=1), np.stack([a, b + sides, a + sides], axis=1)]
    fan = np.stack([np.zeros(sides - 2, int), a[1:-1], a[2:]], axis=1)
    return Mesh(vertices, np.concatenate([*strips, fan[:, ::-1], fan + sides]))


def voxels(radius: float, *, turn: np.ndarray) -> Mesh:
    nodes = np.stack(np.meshgrid(*[np.arange(30) - 14.7] * 3, indexing="ij"), axis=-1)
    mesh = marching_cubes((np.linalg.norm(nodes, axis=-1) < radius).astype(float))
    return mesh.moved(mesh.vertices @ turn.T)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("make", [lambda: cylinder(12), lambda: cylinder(200), lambda: cube(1), lambda: cube(9)])
def test_cad_is_exact_in_any_pose_and_in_single_precision(make, seed):
    turn = Rotation.random(random_state=seed).as_matrix()
    mesh = make()
    mesh = mesh.moved((mesh.vertices @ turn.T).astype(np.float32))
    assert exact_vertices(mesh).all()


@pytest.mark.parametrize("level", [0.002, 0.02, 0.2])
@pytest.mark.parametrize("make", [lambda: cylinder(200), lambda: cube(9), lambda: grid(20, 20)])
def test_a_little_noise_makes_it_measured(make, level):
    assert not exact_vertices(noisy(make(), level)).any()


def test_curved_surfaces_are_not_exact():
    assert not exact_vertices(icosphere(3)).any()


@pytest.mark.parametrize("seed", range(3))
def test_a_segmentation_is_not_exact_though_its_steps_are_flat(seed):
    mesh = voxels(11.0, turn=Rotation.random(random_state=seed).as_matrix())
    assert (coplanar_neighbors(mesh) > 0).mean() > 0.9
    assert lattice_share(mesh) > 0.99
    assert not exact_vertices(mesh).any()


def test_components_are_judged_one_by_one():
    part, scan = cylinder(60), noisy(icosphere(4), 0.2)
    both = Mesh(
        np.concatenate([part.vertices, scan.vertices + 5]),
        np.concatenate([part.faces, scan.faces + len(part.vertices)]),
    )
    exact = exact_vertices(both)
    assert exact[: len(part.vertices)].all() and not exact[len(part.vertices) :].any()


def test_a_flat_patch_does_not_make_a_scan_exact():
    """Scans are closed by planes; they stay measured."""
    scan = noisy(icosphere(5), 0.2)
    cut = scan.moved(np.maximum(scan.vertices, [-2, -2, -0.5]))  # a sixth of the faces in one plane
    assert (coplanar_neighbors(cut) > 0).mean() > 0.15
    assert not exact_vertices(cut).any()


def test_coplanar_neighbors_are_counted_across_edges():
    assert coplanar_neighbors(cube(1)).tolist() == [1] * 12
    inner = coplanar_neighbors(grid(4, 4))
    assert inner.max() == 3 and inner.min() == 1
