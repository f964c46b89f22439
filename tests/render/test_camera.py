"""A camera shows the whole mesh from the chosen side, whatever strays far from it."""

import numpy as np
import pytest
from pictures import black, decoded
from shapes import cube, grid, icosphere, noisy

from cascadenorm.mesh import Mesh
from cascadenorm.render import Camera, render
from cascadenorm.render.files import draw
from cascadenorm.render.scenes import Style


def test_perspective_shows_a_larger_disc_for_the_same_sphere():
    sphere = icosphere(4)
    near = Camera.looking_at(sphere, direction=(0, 0, 1), perspective=0.3)
    distance = 1 / near.perspective
    assert max(near.reach) == pytest.approx(1 / np.sqrt(1 - 1 / distance**2), rel=0.01)  # the tangent cone


def test_an_open_surface_is_seen_from_its_front():
    square = grid(3, 3)
    assert Camera.looking_at(square).axes[2] == pytest.approx([0, 0, 1])
    flipped = Mesh(square.vertices, square.faces[:, ::-1])
    assert Camera.looking_at(flipped).axes[2] == pytest.approx([0, 0, -1])


@pytest.mark.parametrize("direction", [(0, 0, 2), (0, 1, 0), (0, -1, 0), (3, 1, -2)])
def test_the_axes_of_a_camera_are_right_handed_and_orthonormal(direction):
    axes = Camera.looking_at(cube(1), direction=direction).axes
    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1)
    assert axes[2] == pytest.approx(np.array(direction) / np.linalg.norm(direction))


@pytest.mark.compiled
def test_the_whole_mesh_is_seen_from_near():
    """What is nearer moves farther when the middle of the picture moves."""
    corners = [[-2.04, 0.9, -0.28], [-0.17, 0.01, -0.78], [0.23, -1.66, -0.7], [-0.15, 1.1, -0.85], [-0.36, 0.79, 0.67]]
    mesh = Mesh(corners, [[0, 4, 3], [1, 0, 4], [2, 1, 0], [3, 2, 1], [4, 3, 2]])
    picture = render(mesh, view=Camera.looking_at(mesh), size=(200, 200))
    border = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert (border == border[0]).all()


@pytest.mark.compiled
def test_a_crop_is_that_part_of_the_picture():
    """Enlarged without more samples it would be the same pixels."""
    ball = noisy(icosphere(3), 0.3)
    camera = Camera.looking_at(ball, direction=(1, 2, 3))
    whole = render(ball, view=camera, size=(300, 200), samples=4).astype(int)
    part = render(ball, view=camera.cropped(0.6, 0.35, 0.2, size=(300, 200)), size=(60, 60), samples=4).astype(int)
    assert np.abs(part - whole[40:100, 150:210]).mean() < 0.5


def test_a_camera_at_a_distance_sees_its_angle_and_leaves_out_what_is_behind_it():
    square = grid(1, 1).moved(grid(1, 1).vertices - (0.5, 0.5, 0))
    camera = Camera.at_distance((0, 0, 1), (0, 0, 0), 4.0)
    picture = render(square, view=camera, size=(200, 200), colors=black(square))
    covered = np.flatnonzero((picture[100] < 128).any(axis=1))
    assert len(covered) == pytest.approx(200 / (2 * 4 * np.tan(np.radians(15))), abs=1.5)
    behind = square.moved(square.vertices + np.array([0, 0, 5]))
    assert (render(behind, view=camera, size=(50, 50)) == 255).all()
    with pytest.raises(ValueError, match="distance is 0"):
        Camera.at_distance((0, 0, 1), (0, 0, 0), 0)


def test_a_walk_around_ends_where_it_began_and_keeps_all_in_the_picture():
    arm = cube(2).moved(cube(2).vertices * (3, 1, 1))
    cameras = Camera.looking_at(arm, direction=(0, 0, 1)).around(arm, count=8)
    assert len({camera.reach for camera in cameras}) == 1
    assert cameras[2].axes[2] == pytest.approx([1, 0, 0]) and cameras[4].axes[2] == pytest.approx([0, 0, -1])
    for camera in cameras:
        picture = render(arm, view=camera, size=(40, 40), colors=black(arm))
        border = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
        assert (border == 255).all()


@pytest.mark.parametrize(("up", "upward"), [("x", (1, 0, 0)), ("y", (0, 1, 0)), ("z", (0, 0, 1))])
def test_the_chosen_axis_is_upward(up, upward):
    axes = Camera.looking_at(cube(1), up=up).axes
    assert axes[1] @ upward > 0.8 and axes[0] @ upward == pytest.approx(0, abs=1e-12)


def stray(vertices, faces):
    """A cube beside further faces, which count from its last vertex on."""
    body = cube(4)
    faces = np.array(faces, int).reshape(-1, 3) + len(body.vertices)
    return Mesh(np.concatenate([body.vertices, vertices]), np.concatenate([body.faces, faces]))


STRAY = {
    "unreferenced vertex": stray([(1e6, 0, 0)], []),
    "face on one vertex": stray([(1e6, 0, 0)], [(0, 0, 0)]),
    "face without area": stray([(0, 0, 0), (0, 0, 1e5), (0, 0, 2e5)], [(0, 1, 2)]),
    "tiny far face": stray(1e4 + 1e-3 * np.eye(3), [(0, 1, 2)]),
    "spike": stray([(1e6, 0, 0)], [(0, -1, -2)]),
    "huge number": stray([(3e38, 0, 0)], [(0, -1, -2)]),
}


@pytest.mark.parametrize("mesh", STRAY.values(), ids=STRAY)
def test_a_stray_part_does_not_move_the_camera(mesh):
    alone = Camera.looking_at(cube(4), direction=(1, 2, 3))
    camera = Camera.looking_at(mesh, direction=(1, 2, 3))
    assert (camera.center == alone.center).all()
    assert (camera.reach, camera.perspective) == (alone.reach, alone.perspective)
    assert Camera.looking_at(mesh).axes == pytest.approx(Camera.looking_at(cube(4)).axes)


@pytest.mark.parametrize("mesh", STRAY.values(), ids=STRAY)
def test_a_file_with_a_stray_part_shows_the_rest(tmp_path, mesh):
    draw([mesh], tmp_path / "stray.png", Style(size=64))
    assert (decoded((tmp_path / "stray.png").read_bytes())[:64] < 250).any(axis=2).mean() > 0.5


def test_a_long_thin_arm_and_a_far_second_body_stay_in_the_picture():
    body = icosphere(3)
    arm = cube(1).moved((cube(1).vertices - cube(1).vertices.mean(axis=0)) * (0.02, 0.02, 20) + (0, 0, 10))
    other = body.moved(0.3 * body.vertices + (15, 0, 0))
    for extra in (arm, other):
        both = Mesh(
            np.concatenate([body.vertices, extra.vertices]),
            np.concatenate([body.faces, extra.faces + len(body.vertices)]),
        )
        camera = Camera.looking_at(both, direction=(1, 2, 3))
        assert (np.abs(camera.framed(both.vertices)[:, :2]) <= np.array(camera.reach) * 1.2).all()
