"""Vertices on the flat sides of a volume mesh slide along them alone."""

import numpy as np
import pytest
from shapes import ball_of_voxels, cube, cubes, cylinder, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.controls.sliding import outer_planes, sliding
from cascadenorm.mesh import Mesh

STEPS = 8
TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def divided_box() -> Mesh:
    """The cube from -1 to 1 with a wall at x = 0 across it."""
    box, wall = cube(STEPS), grid(STEPS, STEPS)
    across = (wall.vertices * 2 / STEPS - (1, 1, 0))[:, [2, 0, 1]]
    vertices, which = np.unique(np.round(np.concatenate([box.vertices, across]), 9), axis=0, return_inverse=True)
    return Mesh(vertices, which.reshape(-1)[np.concatenate([box.faces, wall.faces + len(box.vertices)])])


BOX = divided_box()
SIDES = (BOX.vertices == -1).astype(int) - (BOX.vertices == 1)
FREE = (SIDES == 0).sum(axis=1)  # 3 in the wall, 2 on sides, 1 on edges, 0 at corners


def rough_box(turn: np.ndarray = TURN) -> Mesh:
    """The box with a wall out of its plane, whose boundary zigzags in the sides of the box."""
    moves = np.random.default_rng(0).normal(size=BOX.vertices.shape) * 0.02 * (SIDES == 0)
    number = np.round((BOX.vertices + 1) * STEPS / 2).astype(int)[:, 1:].sum(axis=1)
    moves[:, 0] += np.where((BOX.vertices[:, 0] == 0) & (FREE < 3), 0.04 * (-1.0) ** number, 0)
    return Mesh((BOX.vertices + moves) @ turn.T * 7 + (1, 2, 3), BOX.faces)


@pytest.mark.parametrize(
    ("mesh", "count"),
    [
        (cube(3), 6),
        (rough_box(), 6),
        (cylinder(32), 2),
        (cubes(ball_of_voxels(6.0)), 0),
        (icosphere(2), 0),
        (noisy(cube(4), 0.1), 0),
        (grid(3, 3), 0),
    ],
    ids=["cube", "turned box", "cylinder", "ball of voxels", "sphere", "noisy cube", "flat"],
)
def test_sides_cover_half_of_the_outline(mesh, count):
    normals, offsets = outer_planes(mesh)
    assert len(normals) == len(offsets) == count
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, rtol=0, atol=1e-12)
    assert (mesh.vertices @ normals.T <= offsets + 1e-9).all()


def test_the_cut_through_a_ball_is_a_side_and_its_outline_has_no_more_freedom():
    ball = icosphere(3)
    half = Mesh(ball.vertices * (1, 1, 0) + np.maximum(ball.vertices, 0) * (0, 0, 1), ball.faces)
    normals, offsets = outer_planes(half)
    np.testing.assert_allclose(normals, [[0, 0, -1]], atol=1e-12)
    np.testing.assert_allclose(offsets, 0, atol=1e-12)
    np.testing.assert_array_equal(sliding(half).vertices, np.flatnonzero(half.vertices[:, 2] == 0))


def test_vertices_keep_the_directions_of_the_planes_that_they_are_on():
    found = sliding(BOX)
    np.testing.assert_array_equal(found.vertices, np.flatnonzero(FREE < 3))
    moves = np.random.default_rng(1).normal(size=BOX.vertices.shape)
    np.testing.assert_allclose(found.constrained(moves), np.where(SIDES == 0, moves, 0), rtol=0, atol=1e-14)


@pytest.mark.parametrize("volume", [None, "keep"])
@pytest.mark.parametrize("method", ["bilateral-normal", "laplacian"])
def test_a_box_stays_flat_and_its_walls_slide_along_it(method, volume):
    rough = rough_box()
    free, slid = (cn.denoise(rough, method=method, volume=volume, slide=s).vertices for s in (None, "planes"))
    size = 14.0
    for side in range(3):
        on = SIDES[:, side] != 0
        moved = (slid - rough.vertices)[on] @ TURN[:, side]
        assert np.abs(moved).max() < 1e-12 * size
        assert np.abs((free - rough.vertices)[on] @ TURN[:, side]).max() > 1e-3 * size
    np.testing.assert_array_equal(slid[FREE == 0], rough.vertices[FREE == 0])
    assert (np.linalg.norm(slid - rough.vertices, axis=1)[(FREE == 1) & (BOX.vertices[:, 0] == 0)] > 1e-3).all()

    # Where the wall meets a side, it comes nearer to its plane
    boundary = (BOX.vertices[:, 0] == 0) & (FREE == 2)
    away = [np.abs((v - (1, 2, 3)) @ TURN[:, 0])[boundary].mean() for v in (rough.vertices, slid)]
    assert away[1] < 0.6 * away[0]


def test_no_face_of_a_side_is_flipped():
    rough = rough_box()
    out = cn.denoise(rough, method="laplacian", iterations=50, slide="planes")
    side = (SIDES[BOX.faces] != 0).all(axis=1).any(axis=1)
    assert ((rough.area_vectors * rough.moved(out.vertices).area_vectors).sum(axis=1)[side] > 0).all()


def test_without_flat_sides_nothing_changes():
    ball = noisy(icosphere(2), 0.1)
    slid, free = (cn.denoise(ball, method="taubin", slide=s).vertices for s in ("planes", None))
    assert slid.tobytes() == free.tobytes()
