"""Computed surfaces are told from measured ones: planes that triangles share exactly, off any lattice."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.data_gen.cad_tessellation import cad_part
from cascadenorm.data_gen.decimate import thinned
from cascadenorm.data_gen.noise import displacements
from cascadenorm.data_gen.surface import UnfitShapeError
from cascadenorm.data_gen.tessellated_part import Part
from cascadenorm.data_gen.volumes import marching_cubes, surface_nets
from cascadenorm.geometry.error_kind import error_kind
from cascadenorm.geometry.exact_surfaces import coplanar_neighbors, exact_vertices
from cascadenorm.geometry.segmentation_steps import has_voxel_faces
from cascadenorm.geometry.voxel_lattice import lattice_share
from cascadenorm.mesh import Mesh, angles_between


def cylinder(sides: int, height: float = 2.0) -> Mesh:
    """A closed cylinder as CAD kernels triangulate one: long strips around, fans at both ends."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    vertices = np.concatenate([ring, ring + np.array([0, 0, height])])
    a, b = np.arange(sides), np.roll(np.arange(sides), -1)
    strips = [np.stack([a, b, b + sides], axis=1), np.stack([a, b + sides, a + sides], axis=1)]
    fan = np.stack([np.zeros(sides - 2, int), a[1:-1], a[2:]], axis=1)
    return Mesh(vertices, np.concatenate([*strips, fan[:, ::-1], fan + sides]))


def ball_of_voxels(radius: float, *, stretch: float = 1.0) -> np.ndarray:
    nodes = np.stack(np.meshgrid(*[np.arange(30) - 14.7] * 3, indexing="ij"), axis=-1)
    return np.linalg.norm(nodes * (1, 1, stretch), axis=-1) < radius


def voxels(radius: float, *, turn: np.ndarray) -> Mesh:
    mesh = marching_cubes(ball_of_voxels(radius).astype(float))
    return mesh.moved(mesh.vertices @ turn.T)


def cubes(inside: np.ndarray) -> Mesh:
    """The squares between voxels inside and outside, two triangles each."""
    padded, corners = np.pad(inside, 1).astype(np.int8), []
    for axis in range(3):
        u, v = (np.eye(3)[(axis + k) % 3] for k in (1, 2))
        for sign in (1, -1):
            low = np.argwhere(np.diff(padded, axis=axis) == -sign) + np.eye(3)[axis]
            square = np.stack([low, low + u, low + u + v, low + v], axis=1)
            corners.append(square if sign > 0 else square[:, ::-1])
    square = np.concatenate(corners)
    vertices, which = np.unique(square.reshape(-1, 3), axis=0, return_inverse=True)
    a, b, c, d = which.reshape(-1, 4).T
    return Mesh(vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]))


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


def torus(rows: int, columns: int, *, waves: float = 0.0) -> Mesh:
    """A torus, its tube of a radius that may vary along it."""
    u, v = np.meshgrid(*(2 * np.pi * np.arange(k) / k for k in (rows, columns)), indexing="ij")
    tube = 0.3 * (1 + waves * np.sin(4 * u) * np.sin(3 * v))
    reach = 1 + tube * np.cos(v)
    vertices = np.stack([reach * np.cos(u), reach * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)
    i, k = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a, b = i * columns + k, (i + 1) % rows * columns + k
    c, d = (i + 1) % rows * columns + (k + 1) % columns, i * columns + (k + 1) % columns
    return Mesh(vertices, np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]))


def spiked(mesh: Mesh, share: float, level: float) -> Mesh:
    rng = np.random.default_rng(0)
    hit = rng.random(len(mesh.vertices)) < share
    return mesh.moved(mesh.vertices + level * mesh.mean_edge_length * hit[:, None] * rng.normal(size=(len(hit), 3)))


def coil(turns: float, steps: int) -> Mesh:
    """A square bar along a helix: all its vertices are on sharp edges."""
    s = np.linspace(0, 2 * np.pi * turns, steps)[:, None]
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.1
    reach, rise = 1 + corners[:, 0], corners[:, 1] + 0.08 * s
    vertices = np.stack([reach * np.cos(s), reach * np.sin(s), rise], axis=-1).reshape(-1, 3)
    a = (4 * np.arange(steps - 1)[:, None] + np.arange(4)).ravel()
    b = (4 * np.arange(steps - 1)[:, None] + np.roll(np.arange(4), -1)).ravel()
    walls = np.concatenate([np.stack([a, a + 4, b + 4], axis=1), np.stack([a, b + 4, b], axis=1)])
    last = 4 * (steps - 1)
    ends = np.array([(0, 1, 2), (0, 2, 3), (last, last + 2, last + 1), (last, last + 3, last + 2)])
    return Mesh(vertices, np.concatenate([walls, ends]))


CURVED = {"torus": torus(60, 24), "thin torus": torus(200, 12), "coarse torus": torus(16, 7), "coil": coil(2.5, 80)}


@pytest.mark.parametrize("name", CURVED)
def test_clean_curved_surfaces_are_exact_and_noise_makes_them_measured(name):
    mesh = CURVED[name]
    assert exact_vertices(mesh).all()
    assert exact_vertices(mesh.moved(mesh.vertices.astype(np.float32))).all()
    assert not exact_vertices(noisy(mesh, 0.15)).any()


@pytest.mark.parametrize("level", [0.03, 0.1, 0.3])
def test_a_little_noise_on_a_fine_torus_is_measured(level):
    assert not exact_vertices(noisy(torus(240, 80), level)).any()


@pytest.mark.parametrize(("share", "level"), [(0.1, 0.2), (0.1, 0.5), (0.3, 0.1)])
def test_spikes_on_a_fine_torus_are_measured(share, level):
    assert not exact_vertices(spiked(torus(240, 80), share, level)).any()


def test_even_triangles_that_are_smooth_all_over_are_not_exact():
    assert not exact_vertices(icosphere(4)).any()


def test_waves_that_go_to_and_fro_are_not_exact():
    assert not exact_vertices(torus(120, 48, waves=0.15)).any()


def test_an_error_alike_over_several_edges_is_measured():
    ball = icosphere(4)
    error = displacements(ball, "correlated", level=0.3, rng=np.random.default_rng(1))
    assert not exact_vertices(ball.moved(ball.vertices + error)).any()


@pytest.mark.parametrize("seed", range(12))
def test_parts_as_cad_kernels_tessellate_them_are_exact(seed):
    rng = np.random.default_rng([7, seed])
    while True:
        try:
            part = cad_part(faces=None, rng=rng)
        except UnfitShapeError:
            continue
        break
    assert exact_vertices(part).all()


@pytest.mark.parametrize("seed", range(3))
def test_a_segmentation_is_not_exact_though_its_steps_are_flat(seed):
    mesh = voxels(11.0, turn=Rotation.random(random_state=seed).as_matrix())
    assert (coplanar_neighbors(mesh) > 0).mean() > 0.9
    assert lattice_share(mesh) > 0.99
    assert not exact_vertices(mesh).any()


@pytest.mark.parametrize("kept", [1.0, 0.6])
@pytest.mark.parametrize("stretch", [1.0, 2.5])
def test_a_segmentation_is_not_exact_whatever_meshed_it(stretch, kept):
    mesh = surface_nets(ball_of_voxels(11.0, stretch=stretch).astype(float))
    mesh = mesh.moved(mesh.vertices * (1, 1, stretch))
    if kept < 1:
        mesh = thinned(mesh, faces=int(kept * len(mesh.faces)), evenness=1e-3)
    assert (coplanar_neighbors(mesh) > 0).mean() > 0.4
    assert lattice_share(mesh) < 0.95 or kept == 1
    assert not exact_vertices(mesh).any()
    assert not exact_vertices(cubes(ball_of_voxels(11.0, stretch=stretch))).any()


@pytest.mark.parametrize("stretch", [1.0, 2.5])
def test_faces_of_voxels_are_told_and_denoised(stretch):
    mesh = cubes(ball_of_voxels(11.0, stretch=stretch))
    middle = np.full(3, 14.7 + 0.5)  # of a mesh that is padded by a voxel and lies between their centres
    turn = Rotation.random(random_state=1).as_matrix()
    mesh = mesh.moved((mesh.vertices - middle) * (1, 1, stretch) @ turn.T)
    assert has_voxel_faces(mesh)
    denoised = cn.denoise(mesh.vertices, mesh.faces)
    assert error_kind(mesh, denoised).kind == "segmentation"
    true = mesh.centroids / np.linalg.norm(mesh.centroids, axis=1)[:, None]
    before, after = (np.degrees(angles_between(m.face_normals, true).mean()) for m in (mesh, mesh.moved(denoised)))
    assert before > 30 and after < 0.3 * before


def test_flat_sides_with_a_grid_are_exact_though_they_lie_on_a_lattice():
    bracket = np.ones((12, 12, 12), bool)
    bracket[4:, 4:] = False
    assert lattice_share(cubes(bracket)) == 1
    assert exact_vertices(cubes(bracket)).all()
    assert not has_voxel_faces(cubes(bracket))
    assert not has_voxel_faces(grid(30, 30))
    assert not has_voxel_faces(icosphere(3))


def test_a_plate_with_many_equal_holes_is_exact_though_its_edges_repeat():
    part = Part(delaunay=True, rng=np.random.default_rng(0))
    angle = 2 * np.pi * np.arange(6) / 6
    hole = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outline = np.array([[-3, -3], [41, -3], [41, 41], [-3, 41]], float)
    loops = [outline, *(hole + np.array([4.0 * i, 4.0 * j]) for i in range(10) for j in range(10))]
    lower, upper = ([part.ring(np.insert(loop, 2, z, axis=1)) for loop in loops] for z in (0.0, 1.0))
    for number, (below, above) in enumerate(zip(lower, upper, strict=True)):
        part.wall([below, above] if number == 0 else [above, below])
    part.face(upper[0], upper[1:])
    part.face(lower[0], lower[1:], up=False)
    plate = part.mesh()
    assert lattice_share(plate) > 0.9
    assert exact_vertices(plate).all()


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
