import io
import sys

import numpy as np
import PIL.Image
import pytest
from shapes import cube, grid, icosphere, noisy

from cascadenorm.cli import run
from cascadenorm.errors import MissingDependencyError
from cascadenorm.interop import save_mesh
from cascadenorm.mesh import Mesh, limit_threads
from cascadenorm.render import Camera, error_colors, error_legend, png, render, side_by_side, webp
from cascadenorm.render.files import draw
from cascadenorm.render.pillow import add_text

RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)


def parallel(mesh, direction=(0, 0, 1)):
    return Camera.looking_at(mesh, direction=direction, perspective=0)


def inked(image):
    """Share of the picture that is covered, as all of it is drawn in black."""
    return 1 - image.mean() / 255


def black(mesh):
    return np.zeros((len(mesh.faces), 3))


def decoded(data):
    """Read a PNG back."""
    with PIL.Image.open(io.BytesIO(data)) as image:
        assert (image.format, image.mode) == ("PNG", "RGB")
        return np.asarray(image)


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


def test_a_picture_has_the_same_bytes_for_any_number_of_threads_and_again():
    mesh = noisy(icosphere(4), 0.3)
    with limit_threads(1):
        once = render(mesh, size=(150, 101))
    with limit_threads(3):
        assert render(mesh, size=(150, 101)).tobytes() == once.tobytes()
    assert render(mesh, size=(150, 101)).tobytes() == once.tobytes()


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


def test_error_colors_darken_all_the_way():
    colors = error_colors(np.linspace(0, 1, 50), limit=1.0)
    brightness = colors @ (0.2126, 0.7152, 0.0722)
    assert (np.diff(brightness) < 0).all()
    assert (error_colors(np.array([1.0, 7.0]), limit=1.0) == colors[-1]).all()


def test_the_legend_runs_from_zero_at_the_bottom():
    legend = error_legend(limit=30, unit="°", size=(80, 300))
    bar = legend[40:-40, 3].astype(int).sum(axis=1)
    assert bar[-1] > bar[0] + 300


def test_panels_keep_their_pixels_and_captions_stand_below():
    left, right = np.full((40, 30, 3), 9, np.uint8), np.full((60, 20, 3), 70, np.uint8)
    sheet = side_by_side([left, right], ["ab", ""], gap=5)
    assert sheet.shape[1] == 55
    assert (sheet[10:50, :30] == left).all()
    assert (sheet[:60, 35:] == right).all()
    assert (sheet[60:, :30] < 200).any()
    assert (sheet[60:, 35:] == 255).all()
    with pytest.raises(ValueError, match="2 pictures and 1 captions"):
        side_by_side([left, right], ["a"])


def written(text, *, size, left=None):
    """Ink of a line of text on a white strip."""
    return 255 - add_text(np.full((120, 400, 3), 255, np.uint8), text, left=left, middle=60, size=size).astype(int)


def test_captions_differ_by_character_and_capitals_are_as_high_as_asked():
    characters = [chr(code) for code in range(33, 127)] + ["°", "é"]
    drawn = {written(character, size=20).tobytes() for character in characters}
    assert len(drawn) == len(characters)
    assert not written(" ", size=20).any()
    for size in (10, 40):
        rows = np.flatnonzero(written("HEX", size=size).any(axis=(1, 2)))
        assert np.ptp(rows) + 1 == pytest.approx(size, abs=1)
        assert rows.mean() == pytest.approx(60, abs=1)


def test_captions_are_centered_and_cut_where_the_picture_ends():
    columns = np.flatnonzero(written("HEX", size=20).any(axis=(0, 2)))
    assert columns.mean() == pytest.approx(200, abs=2)
    assert np.flatnonzero(written("HEX", size=20, left=7).any(axis=(0, 2)))[0] == pytest.approx(7, abs=3)
    long = written("H" + 100 * "m", size=20)
    assert long[:, -1].any()
    assert (long[:, :12] == written("H", size=20, left=0)[:, :12]).all()


@pytest.mark.parametrize("name", ["two\nlines", "\udcff", "\0", "\t", "名前"])
def test_any_name_of_a_file_is_a_caption_of_one_line(name):
    rows = np.flatnonzero(written(name, size=20).any(axis=(1, 2)))
    assert 0 < np.ptp(rows) < 40


def test_pictures_without_pillow_say_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(MissingDependencyError, match="needs Pillow") as raised:
        draw([cube(1)], tmp_path / "cube.png")
    assert raised.value.extra == "viz"
    assert not list(tmp_path.iterdir())
    assert render(cube(1), size=(9, 9)).shape == (9, 9, 3)


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
    draw([mesh], tmp_path / "stray.png", size=64)
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
        draw([icosphere(2).moved(icosphere(2).vertices * size)], tmp_path / f"{name}.png", size=64)
    usual, other = (decoded((tmp_path / f"{name}.png").read_bytes()) for name in ("usual", "other"))
    assert (np.abs(usual.astype(int) - other) > 8).mean() < 0.01


def test_each_mesh_is_seen_also_where_it_lies_elsewhere_than_the_last(tmp_path):
    here = icosphere(2)
    beside, far = (here.moved(here.vertices * size + np.array([x, 0, 0])) for size, x in ((1, 0.1), (0.01, 500)))
    draw([far, beside, here], tmp_path / "all.png", size=64)
    sheet = decoded((tmp_path / "all.png").read_bytes())[:64]
    panels = [sheet[:, start : start + 64] for start in range(0, sheet.shape[1], 64 + 12)]
    middles = [np.argwhere((panel < 250).any(axis=2)).mean(axis=0)[1] for panel in panels]
    assert middles[0] == pytest.approx(middles[2], abs=0.5)  # by itself
    assert middles[1] > middles[2] + 1  # as it lies to the last


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


@pytest.mark.parametrize("view", ["1,2", "a,b,c", "0,0,0", "nan,0,1", "inf,0,1"])
def test_a_view_is_three_numbers(view, tmp_path, capsys):
    assert run(["render", "any.ply", "-o", str(tmp_path / "x.png"), f"--view={view}"]) == 2
    assert "--view" in capsys.readouterr().err
