import io

import numpy as np
import PIL.Image
import pytest
from pictures import decoded
from shapes import cube, grid, icosphere, noisy

from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh, limit_threads
from cascadenorm.render import Camera, HeatMap, color_map, png, render, webp
from cascadenorm.render.color import linear, named_colors
from cascadenorm.render.files import draw
from cascadenorm.render.scenes import Style

RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)


def parallel(mesh, direction=(0, 0, 1)):
    return Camera.looking_at(mesh, direction=direction, perspective=0)


def inked(image):
    """Share of the picture that is covered, as all of it is drawn in black."""
    return 1 - image.mean() / 255


def black(mesh):
    return np.zeros((len(mesh.faces), 3))


@pytest.mark.compiled
@pytest.mark.parametrize("direction", [(0, 0, 1), (1, 2, 3)])
def test_the_silhouette_of_a_sphere_has_the_area_of_its_disc(direction):
    sphere = icosphere(5)
    camera = parallel(sphere, direction)
    image = render(sphere, view=camera, size=(200, 200), colors=black(sphere))
    frame = (2 * 1.06 * max(camera.reach)) ** 2
    assert inked(image) * frame == pytest.approx(np.pi, rel=0.01)


def test_perspective_shows_a_larger_disc_for_the_same_sphere():
    sphere = icosphere(4)
    near = Camera.looking_at(sphere, direction=(0, 0, 1), perspective=0.3)
    distance = 1 / near.perspective
    assert max(near.reach) == pytest.approx(1 / np.sqrt(1 - 1 / distance**2), rel=0.01)  # the tangent cone


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
@pytest.mark.parametrize("perspective", [0, 0.3])
def test_the_nearer_triangle_hides_the_farther_one(order, perspective):
    triangle = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], float)
    corners = np.stack([triangle, triangle + np.array([0, 0, 0.2])])[order]
    mesh = Mesh(corners.reshape(-1, 3), np.arange(6).reshape(2, 3))
    colors = np.array([RED, BLUE])[order]
    camera = Camera.looking_at(mesh, direction=(0, 0, 1), perspective=perspective)
    red, _, blue = render(mesh, view=camera, size=(90, 90), colors=colors)[50, 40]
    assert blue > 2 * red


def test_triangles_that_pierce_each_other_are_cut_where_they_meet():
    mesh = Mesh(
        [(-1, -1, -1), (1, -1, 1), (1, 1, 1), (-1, 1, -1), (-1, -1, 1), (1, -1, -1), (1, 1, -1), (-1, 1, 1)],
        [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)],
    )
    image = render(mesh, view=parallel(mesh), size=(106, 106), colors=np.array([RED, RED, BLUE, BLUE]))
    assert (image[50, 10:50, 2] > image[50, 10:50, 0]).all()
    assert (image[50, 56:96, 0] > image[50, 56:96, 2]).all()


def test_pixels_between_two_triangles_are_not_left_out():
    square = grid(7, 7)
    image = render(square, view=parallel(square), size=(123, 123), colors=black(square))
    covered = image[5:-5, 5:-5]
    assert (covered == covered[0, 0]).all()


def test_the_inside_of_a_surface_has_another_color():
    square = grid(2, 2)
    front = render(square, view=(0, 0, 1), size=(20, 20))[10, 10].astype(int)
    back = render(square, view=(0, 0, -1), size=(20, 20))[10, 10].astype(int)
    assert front[2] > front[0]
    assert back[0] > back[2]


def test_faces_that_meet_at_an_edge_are_shaded_differently():
    image = render(cube(1), size=(60, 60), samples=1)
    shades = {tuple(pixel) for pixel in image.reshape(-1, 3)}
    assert len(shades) == 4  # three sides and the paper


@pytest.mark.compiled
def test_a_picture_has_the_same_bytes_for_any_number_of_threads_and_again():
    mesh = noisy(icosphere(4), 0.3)
    with limit_threads(1):
        once = render(mesh, size=(150, 101))
    with limit_threads(3):
        assert render(mesh, size=(150, 101)).tobytes() == once.tobytes()
    assert render(mesh, size=(150, 101)).tobytes() == once.tobytes()


@pytest.mark.compiled
def test_the_picture_does_not_depend_on_place_and_scale():
    mesh = noisy(icosphere(3), 0.3)
    far = Mesh(mesh.vertices * 1024 + 2**20, mesh.faces)
    difference = render(mesh, size=(80, 80)).astype(int) - render(far, size=(80, 80))
    assert np.abs(difference).mean() < 0.05


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


def test_a_mesh_without_extent_leaves_the_paper_white():
    assert (render(Mesh(np.ones((3, 3)), [(0, 1, 2)]), size=(9, 9)) == 255).all()


@pytest.mark.parametrize("wrong", [{"size": (0, 9)}, {"samples": 0}, {"view": (0, 0, 0)}, {"view": (1, 2)}])
def test_senseless_settings_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        render(cube(1), **wrong)
    with pytest.raises(ValueError, match="perspective is 1"):
        Camera.looking_at(cube(1), perspective=1)


@pytest.mark.compiled
def test_the_whole_mesh_is_seen_from_near():
    """What is nearer moves farther when the middle of the picture moves."""
    corners = [[-2.04, 0.9, -0.28], [-0.17, 0.01, -0.78], [0.23, -1.66, -0.7], [-0.15, 1.1, -0.85], [-0.36, 0.79, 0.67]]
    mesh = Mesh(corners, [[0, 4, 3], [1, 0, 4], [2, 1, 0], [3, 2, 1], [4, 3, 2]])
    picture = render(mesh, view=Camera.looking_at(mesh), size=(200, 200))
    border = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
    assert (border == border[0]).all()


def test_a_webp_decodes_to_nearly_the_same_pixels():
    image = render(noisy(icosphere(2), 0.3), size=(61, 47))
    data = webp(image)
    with PIL.Image.open(io.BytesIO(data)) as read:
        assert np.abs(np.asarray(read.convert("RGB")).astype(int) - image).mean() < 5
    assert webp(image) == data


def test_a_png_decodes_to_the_same_pixels():
    image = render(noisy(icosphere(2), 0.3), size=(61, 47))
    assert (decoded(png(image)) == image).all()


@pytest.mark.compiled
def test_a_value_has_its_color_at_faces_and_between_vertices():
    square = grid(1, 1)
    view = parallel(square)
    for at, values in (("face", [0.25, 0.25]), ("vertex", square.vertices[:, 0])):
        heat = HeatMap(np.array(values, float), at, (0.0, 1.0))
        picture = render(square, view=view, size=(212, 212), values=heat)
        for column in (40, 106, 170):
            value = 0.25 if at == "face" else (column + 0.5 - 6) / 200
            expected = linear(color_map(signed=False)[round(255 * value)])
            light = linear(picture[100, column] / 255) / expected
            assert np.ptp(light) < 0.05 * light.mean()  # the hue is that of the value


def test_values_between_vertices_are_seen_in_perspective():
    """Straight bands on a tilted plane stay straight: the middle value lies on the middle of the plane."""
    tilted = grid(1, 1).moved(grid(1, 1).vertices @ np.array([(1, 0, 0), (0, 0.2, 2), (0, 0, 1)]))
    camera = Camera.looking_at(tilted, direction=(0, 0.3, 1), perspective=0.5)
    heat = HeatMap(np.array([0.0, 0, 1, 1]), "vertex", (0.0, 1.0))
    picture = render(tilted, view=camera, size=(300, 300), values=heat, samples=1).astype(int)
    middle = np.rint(255 * color_map(signed=False)[128])
    column = picture[:, 150]
    covered = np.flatnonzero((column < 250).any(axis=1))
    hue = column[covered] / column[covered].sum(axis=1, keepdims=True)
    found = covered[np.abs(hue - middle / middle.sum()).sum(axis=1).argmin()]
    screen = camera.framed(tilted.vertices.mean(axis=0)[None])
    y = (screen / (1 - camera.perspective * screen[:, 2:]))[0, 1]
    expected = 150 - y * 300 / 2 / camera.half_size((300, 300))[1]
    assert found == pytest.approx(expected, abs=4)
    assert abs(expected - covered.mean()) > 8  # where it would lie without perspective


def test_what_has_no_value_is_grey():
    heat = HeatMap(np.array([np.nan, 0.5]), "face", (0.0, 1.0))
    picture = render(grid(1, 1), view=parallel(grid(1, 1)), size=(50, 50), values=heat)
    grey = [pixel for pixel in picture.reshape(-1, 3) if np.ptp(pixel.astype(int)) < 2 and pixel[0] < 250]
    assert 900 < len(grey) < 1250 and np.median(grey) <= 255 * named_colors("unknown").max()


def test_a_wireframe_has_lines_along_the_edges_only():
    square = grid(2, 2)
    view = parallel(square)
    plain, lines = (
        render(square, view=view, size=(212, 212), wireframe=wire).astype(int).sum(axis=2) for wire in (False, True)
    )
    darker = lines < plain - 30
    x, y = np.meshgrid((np.arange(212) + 0.5 - 6) / 100, (206 - np.arange(212) - 0.5) / 100)
    ends = square.vertices[square.topology.edges][..., :2]
    away = np.full(x.shape, np.inf)
    for a, b in ends:
        along = b - a
        t = np.clip(((x - a[0]) * along[0] + (y - a[1]) * along[1]) / (along @ along), 0, 1)
        away = np.minimum(away, np.hypot(x - a[0] - t * along[0], y - a[1] - t * along[1]))
    assert not darker[away > 0.015].any()
    inside = (np.abs(x - 1) < 0.97) & (np.abs(y - 1) < 0.97)
    assert darker[(away < 0.002) & inside].mean() > 0.9


def test_smooth_shading_of_a_sphere_has_no_steps():
    ball = icosphere(2)
    flat, smooth = (render(ball, view=(0, 0, 1), size=(100, 100), smooth=on).astype(int) for on in (False, True))
    steps = [np.abs(np.diff(picture[50, 20:80, 0])).max() for picture in (flat, smooth)]
    assert steps[1] < 0.3 * steps[0]


@pytest.mark.compiled
def test_a_transparent_picture_over_white_is_the_plain_one():
    ball = icosphere(3)
    plain, clear = (render(ball, size=(60, 60), transparent=on) for on in (False, True))
    assert clear.shape == (60, 60, 4) and clear[0, 0, 3] == 0 and clear[30, 30, 3] == 255
    share = clear[..., 3:] / 255
    over = linear(clear[..., :3] / 255) * share + (1 - share)
    assert np.abs(linear(plain / 255) - over).max() < 0.02


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


@pytest.mark.parametrize("scale", [1e300, 1e-310])
def test_the_size_of_the_coordinates_does_not_matter(tmp_path, scale):
    for name, size in (("usual", 1.0), ("other", scale)):
        draw([icosphere(2).moved(icosphere(2).vertices * size)], tmp_path / f"{name}.png", Style(size=64))
    usual, other = (decoded((tmp_path / f"{name}.png").read_bytes()) for name in ("usual", "other"))
    assert (np.abs(usual.astype(int) - other) > 8).mean() < 0.01


@pytest.mark.compiled
def test_each_mesh_is_seen_also_where_it_lies_elsewhere_than_the_last(tmp_path):
    here = icosphere(2)
    beside, far = (here.moved(here.vertices * size + np.array([x, 0, 0])) for size, x in ((1, 0.1), (0.01, 500)))
    draw([far, beside, here], tmp_path / "all.png", Style(size=64))
    sheet = decoded((tmp_path / "all.png").read_bytes())[:64]
    panels = [sheet[:, start : start + 64] for start in range(0, sheet.shape[1], 64 + 12)]
    middles = [np.argwhere((panel < 250).any(axis=2)).mean(axis=0)[1] for panel in panels]
    assert middles[0] == pytest.approx(middles[2], abs=0.5)  # by itself
    assert middles[1] > middles[2] + 1  # as it lies to the last


@pytest.mark.compiled
def test_meshes_are_seen_from_where_one_is_told(tmp_path):
    flat = icosphere(2).moved(icosphere(2).vertices * (1, 1, 0.1))
    height = []
    for name, view in (("front", "0,0,1"), ("side", "-2,0,0")):
        save_mesh(tmp_path / "flat.ply", flat, force=True)
        arguments = ["render", str(tmp_path / "flat.ply"), "-o", str(tmp_path / f"{name}.png"), "--size", "64"]
        assert run([*arguments, f"--view={view}"]) == 0
        with PIL.Image.open(tmp_path / f"{name}.png") as picture:
            dark = np.asarray(picture.convert("L"))[:64] < 250
        height.append(np.ptp(np.argwhere(dark)[:, 1]) / np.ptp(np.argwhere(dark)[:, 0]))
    assert height[0] == pytest.approx(1, abs=0.05) and height[1] == pytest.approx(0.1, abs=0.05)


@pytest.mark.parametrize("view", ["1", "a,b,c", "sideways", "0,0,0", "nan,0,1", "inf,0,1"])
def test_a_view_is_three_numbers(view, tmp_path, capsys):
    assert run(["render", "any.ply", "-o", str(tmp_path / "x.png"), f"--view={view}"]) == 2
    assert "--view" in capsys.readouterr().err


def test_vertices_that_all_lie_at_the_origin_are_drawn_in_silence(tmp_path):
    draw([Mesh(np.zeros((3, 3)), [[0, 1, 2]])], tmp_path / "a.png", Style(size=16))
    assert (tmp_path / "a.png").stat().st_size
