"""Regions that share walls, denoised: walls and junction curves near the truth, shared to the last bit."""

import numpy as np
import pytest
from partitions import PARTITIONS, VOLUMES, LabelledMesh, walls

import cascadenorm as cn
from cascadenorm.mesh import Mesh, unit


def moved(found, vertices):
    return LabelledMesh(found.mesh.moved(vertices), found.labels)


def wall_angle(found, partition):
    """Mean angle to the true walls in degrees, by area."""
    mesh = found.mesh
    true = partition.normals(mesh.centroids, found.labels)
    angles = np.degrees(np.arccos(np.clip((true * mesh.face_normals).sum(axis=1), -1, 1)))
    return np.average(angles, weights=mesh.areas)


def junctions(found, partition):
    """RMS distance of the vertices of junction curves from these, in edges, and mean angle of their edges to them."""
    mesh = found.mesh
    regions = partition.regions(np.zeros((1, 3))).shape[1] + 1
    sets = found.vertex_sets(regions)
    edges = mesh.topology.edges[mesh.topology.edge_faces.counts >= 3]
    along = sets[edges[:, 0]] & sets[edges[:, 1]]
    edges, along = edges[along.sum(axis=1) == 3], along[along.sum(axis=1) == 3]
    middle = mesh.vertices[edges].mean(axis=1)
    feet = partition.nearest(middle, along)
    _, values, axes = np.linalg.svd(partition.gradients(feet, along))
    directions = unit(mesh.vertices[edges[:, 1]] - mesh.vertices[edges[:, 0]])
    angles = np.degrees(np.arccos(np.minimum(np.abs((axes[:, 2] * directions).sum(axis=1)), 1)))
    away = np.linalg.norm(feet - middle, axis=1) / mesh.mean_edge_length
    crossing = values[:, 1] > 0.5  # where two cubes share a side, both gradients may be its normal: no tangent is known
    return np.sqrt(np.mean(away**2)), angles[crossing].mean()


def volumes(found):
    return np.array([found.region(label).volume for label in range(1, found.labels.max() + 1)])


@pytest.mark.parametrize("name", PARTITIONS)
def test_auto_straightens_walls_and_junction_curves(name):
    found, partition = walls(name), PARTITIONS[name]
    denoised = moved(found, cn.denoise(found.mesh.vertices, found.mesh.faces))
    assert wall_angle(denoised, partition) < 0.3 * wall_angle(found, partition)
    (away, angle), (away_before, angle_before) = junctions(denoised, partition), junctions(found, partition)
    assert away < 0.6 * away_before and angle < 0.3 * angle_before
    off, off_before = (np.abs(volumes(each) / VOLUMES[name] - 1) for each in (denoised, found))
    assert (off < off_before + (0.015 if name == "cube in cube" else 0.003)).all()  # nets cut corners off


@pytest.mark.parametrize("method", ["bilateral-normal", "guided-normal", "taubin"])
def test_every_method_treats_both_sides_of_a_wall(method):
    found, partition = walls("half balls"), PARTITIONS["half balls"]
    denoised = moved(found, cn.denoise(found.mesh.vertices, found.mesh.faces, method=method))
    assert wall_angle(denoised, partition) < 0.6 * wall_angle(found, partition)
    assert junctions(denoised, partition)[1] < 0.4 * junctions(found, partition)[1]


def test_orientation_of_walls_does_not_matter():
    found = walls("half balls")
    rng = np.random.default_rng(0)
    faces = np.where(rng.random((len(found.mesh.faces), 1)) < 0.3, found.mesh.faces[:, ::-1], found.mesh.faces)
    options = {"method": "bilateral-normal", "iterations": 5}
    expected = cn.denoise(found.mesh.vertices, found.mesh.faces, **options)
    np.testing.assert_allclose(cn.denoise(found.mesh.vertices, faces, **options), expected, atol=1e-9)


def test_a_wall_that_is_there_twice_moves_as_one():
    found = walls("half balls")
    both = np.concatenate([found.region(1).faces, found.region(2).faces])
    options = {"method": "bilateral-normal", "iterations": 5}
    expected = cn.denoise(found.mesh.vertices, found.mesh.faces, **options)
    np.testing.assert_allclose(cn.denoise(found.mesh.vertices, both, **options), expected, atol=1e-9)


def test_same_bytes_for_one_and_all_threads():
    found = walls("four cells")
    one, two = (cn.denoise(found.mesh.vertices, found.mesh.faces, threads=n) for n in (1, 2))
    assert one.tobytes() == two.tobytes()


def test_exact_walls_stay():
    """A cube of two boxes with flat walls, as CAD leaves them."""
    corners = np.array([(x, y, z) for x in (0, 1, 2) for y in (0, 1) for z in (0, 1)], float)
    quads = [(x, x + 1, x + 3, x + 2) for x in (0, 4, 8)]
    quads += [(a, a + 4, b + 4, b) for a, b in ((0, 1), (1, 3), (3, 2), (2, 0), (4, 5), (5, 7), (7, 6), (6, 4))]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    assert (cn.denoise(corners, faces) == corners).all()


def test_fixed_vertices_and_creases_reach_the_shells():
    found = walls("half balls")
    mesh = found.mesh
    fixed = np.arange(0, len(mesh.vertices), 7)
    edges = mesh.topology.edges[mesh.topology.edge_faces.counts >= 3]
    options = {"method": "bilateral-normal", "iterations": 5}
    vertices = cn.denoise(mesh.vertices, mesh.faces, fixed=fixed, creases=edges, **options)
    assert (vertices[fixed] == mesh.vertices[fixed]).all() and (vertices != mesh.vertices).any()
    free = cn.denoise(mesh.vertices, mesh.faces, fixed=fixed, **options)
    assert (free != vertices).any()


def test_walls_open_at_the_border_of_the_volume():
    found = walls("four cells")
    inside = (np.abs(found.mesh.vertices) < 0.5).all(axis=1)[found.mesh.faces].all(axis=1)
    mesh = Mesh(found.mesh.vertices, found.mesh.faces[inside])
    part = LabelledMesh(mesh, found.labels[inside])
    vertices = cn.denoise(mesh.vertices, mesh.faces)
    before, after = (wall_angle(p, PARTITIONS["four cells"]) for p in (part, moved(part, vertices)))
    assert after < 0.3 * before


@pytest.mark.parametrize("name", PARTITIONS)
def test_volume_of_each_region_is_kept(name):
    found = walls(name)
    fixed = np.arange(50)
    options = {"method": "taubin", "iterations": 20, "fixed": fixed}
    free = moved(found, cn.denoise(found.mesh.vertices, found.mesh.faces, **options))
    kept = moved(found, cn.denoise(found.mesh.vertices, found.mesh.faces, volume="keep", **options))
    assert (np.abs(volumes(free) / volumes(found) - 1) > 1e-3).all()
    np.testing.assert_allclose(volumes(kept), volumes(found), rtol=1e-9)
    assert (kept.mesh.vertices[fixed] == found.mesh.vertices[fixed]).all()
    assert np.abs(kept.mesh.vertices - free.mesh.vertices).max() < 0.1 * found.mesh.mean_edge_length
