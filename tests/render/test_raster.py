"""Pixels are covered by the nearest triangles, without gaps, with the same bytes for any number of threads."""

import numpy as np
import pytest
from pictures import black, parallel
from shapes import grid, icosphere, noisy

from cascadenorm.mesh import Mesh, limit_threads
from cascadenorm.render import Camera, HeatMap, color_map, render

RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)


def inked(image):
    """Share of the picture that is covered, as all of it is drawn in black."""
    return 1 - image.mean() / 255


@pytest.mark.compiled
@pytest.mark.parametrize("direction", [(0, 0, 1), (1, 2, 3)])
def test_the_silhouette_of_a_sphere_has_the_area_of_its_disc(direction):
    sphere = icosphere(5)
    camera = parallel(sphere, direction)
    image = render(sphere, view=camera, size=(200, 200), colors=black(sphere))
    frame = (2 * 1.06 * max(camera.reach)) ** 2
    assert inked(image) * frame == pytest.approx(np.pi, rel=0.01)


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


@pytest.mark.compiled
def test_a_picture_has_the_same_bytes_for_any_number_of_threads_and_again():
    mesh = noisy(icosphere(4), 0.3)
    with limit_threads(1):
        once = render(mesh, size=(150, 101))
    with limit_threads(3):
        assert render(mesh, size=(150, 101)).tobytes() == once.tobytes()
    assert render(mesh, size=(150, 101)).tobytes() == once.tobytes()


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


@pytest.mark.compiled
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
