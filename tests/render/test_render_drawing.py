"""Faces are shaded by two lights, and values are shown as their colours."""

import numpy as np
import pytest
from pictures import parallel
from shapes import cube, grid, icosphere, noisy

from cascadenorm.mesh import Mesh
from cascadenorm.render import Camera, HeatMap, color_map, render
from cascadenorm.render.color import linear, named_colors


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
def test_the_picture_does_not_depend_on_place_and_scale():
    mesh = noisy(icosphere(3), 0.3)
    far = Mesh(mesh.vertices * 1024 + 2**20, mesh.faces)
    difference = render(mesh, size=(80, 80)).astype(int) - render(far, size=(80, 80))
    assert np.abs(difference).mean() < 0.05


def test_a_mesh_without_extent_leaves_the_paper_white():
    assert (render(Mesh(np.ones((3, 3)), [(0, 1, 2)]), size=(9, 9)) == 255).all()


@pytest.mark.parametrize("wrong", [{"size": (0, 9)}, {"samples": 0}, {"view": (0, 0, 0)}, {"view": (1, 2)}])
def test_senseless_settings_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        render(cube(1), **wrong)
    with pytest.raises(ValueError, match="perspective is 1"):
        Camera.looking_at(cube(1), perspective=1)


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


def test_what_has_no_value_is_grey():
    heat = HeatMap(np.array([np.nan, 0.5]), "face", (0.0, 1.0))
    picture = render(grid(1, 1), view=parallel(grid(1, 1)), size=(50, 50), values=heat)
    grey = [pixel for pixel in picture.reshape(-1, 3) if np.ptp(pixel.astype(int)) < 2 and pixel[0] < 250]
    assert 900 < len(grey) < 1250 and np.median(grey) <= 255 * named_colors("unknown").max()


@pytest.mark.compiled
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
