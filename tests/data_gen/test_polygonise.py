"""Polygonisers and editing: convergence, exactness on flat faces, manifolds all the way."""

import numpy as np
import pytest

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.decimate import decimate
from cascadenorm.data_gen.meshing.half_edges import half_edges_of, is_manifold, mesh_of
from cascadenorm.data_gen.meshing.lattice import sample
from cascadenorm.data_gen.meshing.polygonise import dual_contouring, marching_cubes
from cascadenorm.data_gen.meshing.remesh import SHORT, collapse_short, flip_edges, slide, split_long
from cascadenorm.data_gen.meshing.surface import extent_of, untangled
from cascadenorm.data_gen.meshing.tessellation import Tessellation, shape_creases, tessellate
from cascadenorm.data_gen.scanning.views import scanned_view
from cascadenorm.data_gen.shapes import fields, placement
from cascadenorm.mesh import Mesh, unit

TURN = placement.random_rotation(rng=np.random.default_rng(5))
HALF = np.array([0.7, 0.6, 0.5])
CUBE = placement.moved(fields.box(HALF), rotation=TURN)


def lattice_of(field, spacing, *, jitter=0.0, seed=0):
    rng = np.random.default_rng(seed)
    return sample(field, lower=[-1.3] * 3, upper=[1.3] * 3, spacing=spacing, jitter=jitter, rng=rng)


def test_marching_cubes_on_the_sphere_converges_at_second_order():
    steps = np.array([0.2, 0.1, 0.05])
    error = [4 / 3 * np.pi - marching_cubes(s := fields.sphere(radius=1), lattice_of(s, h)).volume for h in steps]
    assert min(error) > 0
    assert np.polyfit(np.log(steps), np.log(error), 1)[0] == pytest.approx(2, abs=0.15)


def test_skipping_blocks_changes_nothing():
    field = CUBE
    lattice = lattice_of(field, 0.08, jitter=0.2)
    full = field(lattice.nodes.reshape(-1, 3)).reshape(lattice.values.shape)
    near = np.abs(full) < 0.2
    np.testing.assert_array_equal(lattice.values[near], full[near])
    np.testing.assert_array_equal(np.sign(lattice.values), np.sign(full))


@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_dual_contouring_of_a_cube_has_six_flat_sides_and_straight_edges(jitter):
    mesh = untangled(dual_contouring(CUBE, lattice_of(CUBE, 0.07, jitter=jitter)))
    local = mesh.vertices @ TURN
    on_sides = np.isclose(np.abs(local), HALF, atol=1e-6)
    assert on_sides.any(axis=1).mean() > 0.99  # all vertices are on a side
    assert np.abs(CUBE(mesh.vertices)).max() < 0.02
    assert mesh.volume == pytest.approx(8 * HALF.prod(), rel=2e-4)
    sides = np.abs(mesh.face_normals @ TURN).max(axis=1)
    assert mesh.areas[sides > 1 - 1e-9].sum() > 0.99 * mesh.area  # and nearly all the area is flat
    on_edges = on_sides.sum(axis=1) == 2
    length = 8 * HALF.sum()
    assert on_edges.sum() > 0.7 * length / 0.07
    assert (on_sides.sum(axis=1) == 3).sum() >= 7


def test_creases_of_a_tessellated_cube_are_its_twelve_edges():
    rng = np.random.default_rng(2)
    mesh = tessellate(CUBE, extent_of(CUBE, rng=rng), faces=3000, sharp=True, tessellation="even", rng=rng)
    ends = mesh.vertices[mesh.topology.edges[shape_creases(CUBE, mesh)]]
    assert (np.isclose(np.abs(ends @ TURN), HALF, atol=1e-4).sum(axis=2) >= 2).mean() > 0.99
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(8 * HALF.sum(), rel=0.03)


def test_orientation_is_outward_for_holes_too():
    hollow = fields.shell(fields.sphere(radius=0.9), thickness=0.4)
    for polygonise in (marching_cubes, dual_contouring):
        mesh = polygonise(hollow, lattice_of(hollow, 0.08, jitter=0.2))
        assert mesh.volume == pytest.approx(4 / 3 * np.pi * (1.1**3 - 0.7**3), rel=0.02)


def test_untangling_gives_touching_tetrahedra_vertices_of_their_own():
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    at_a_vertex = Mesh(np.concatenate([corner, -corner[1:]]), np.concatenate([faces, _mirrored(faces, [0, 4, 5, 6])]))
    assert not is_manifold(at_a_vertex)
    apart = untangled(at_a_vertex)
    assert is_manifold(apart)
    assert len(apart.vertices) == 8

    at_an_edge = Mesh(
        np.concatenate([corner, [[0, -1, 0], [0, 0, -1]]]), np.concatenate([faces, _mirrored(faces, [0, 1, 4, 5])])
    )
    assert not is_manifold(at_an_edge)
    apart = untangled(at_an_edge)
    assert is_manifold(apart)
    assert apart.topology.edge_faces.counts.max() == 2
    assert apart.volume > 0


def _mirrored(faces, names):
    """The same tetrahedron over other vertices, after a reflection through the origin or by two axes."""
    faces = np.array(names)[faces]
    return faces[:, ::-1] if names[1] != 1 else faces


@pytest.mark.parametrize("rule", ["valence", "delaunay"])
def test_remeshing_keeps_a_closed_manifold_and_its_volume(rule):
    sphere = fields.sphere(radius=1)
    corners = half_edges_of(marching_cubes(sphere, lattice_of(sphere, 0.1)))
    target = 0.12
    corners.length[:] = target
    for _ in range(5):
        split_long(corners)
        collapse_short(corners, SHORT)
        flip_edges(corners, rule=rule)
        slide(corners, 0.5)
    mesh = mesh_of(corners)
    assert is_manifold(mesh)
    assert (mesh.topology.edge_faces.counts == 2).all()
    assert len(mesh.vertices) - len(mesh.topology.edges) + len(mesh.faces) == 2
    assert mesh.volume == pytest.approx(4 / 3 * np.pi, rel=0.02)
    ends = mesh.vertices[mesh.topology.edges]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert np.mean((length > 0.7 * target) & (length < 4 / 3 * target)) > 0.98


def test_decimating_a_cube_loses_nothing_of_it():
    mesh = untangled(dual_contouring(CUBE, lattice_of(CUBE, 0.1)))
    corners = half_edges_of(mesh)
    corners.length[:] = 1.0
    decimate(corners, faces=len(mesh.faces) // 4, evenness=1e-6)
    thinned = mesh_of(corners)
    assert is_manifold(thinned)
    assert len(thinned.faces) < 0.3 * len(mesh.faces)
    assert thinned.volume == pytest.approx(mesh.volume, rel=1e-3)


@pytest.mark.parametrize("tessellation", Tessellation.__args__)
@pytest.mark.parametrize("sharp", [True, False])
def test_every_tessellation_makes_closed_meshes_of_about_the_wanted_size(tessellation, sharp):
    field = fields.difference(CUBE, placement.moved(fields.cylinder(radius=0.3, half_height=2.0), rotation=TURN))
    rng = np.random.default_rng(3)
    extent = extent_of(field, rng=rng)
    mesh = tessellate(field, extent, faces=6000, sharp=sharp, tessellation=tessellation, rng=rng)
    assert is_manifold(mesh)
    assert (mesh.topology.edge_faces.counts == 2).all()
    assert 4000 < len(mesh.faces) < 9000
    assert mesh.areas.min() > 0
    assert np.abs(field(mesh.vertices)).mean() < 0.02


def test_a_view_is_what_is_seen_from_one_side():
    ball = fields.sphere(radius=1)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        mesh = scanned_view(ball, extent_of(ball, rng=rng), faces=4000, rng=rng)
        assert 0.6 * 4000 < len(mesh.faces) < 1.6 * 4000 and is_manifold(mesh)
        np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, atol=2e-3)
        toward = unit(mesh.area_vectors.sum(axis=0)[None])[0]
        assert (mesh.vertices @ toward).min() > -0.05
        assert (mesh.face_normals * mesh.centroids).sum(axis=1).min() > 0.9


def test_an_empty_shape_is_unfit():
    with pytest.raises(UnfitShapeError, match="empty"):
        extent_of(fields.sphere(radius=-1.0), rng=np.random.default_rng(0))
