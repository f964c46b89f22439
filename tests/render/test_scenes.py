"""Meshes in one figure share a scale, a camera where it shows them, and the colours of values."""

import re

import numpy as np
import PIL.Image
import pytest
from pictures import decoded, drawn
from shapes import cube, icosphere, noisy

from cascadenorm.errors import ParameterError
from cascadenorm.geometry.curvature import mean_curvature
from cascadenorm.geometry.metrics import measure
from cascadenorm.mesh import Mesh
from cascadenorm.render import Camera
from cascadenorm.render.figure import ACCENTS
from cascadenorm.render.files import draw
from cascadenorm.render.scenes import FRAMES as TURNS
from cascadenorm.render.scenes import Style

BALL = icosphere(3)
ROUGH = noisy(BALL, 0.3)


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


def test_vertices_that_all_lie_at_the_origin_are_drawn_in_silence(tmp_path):
    draw([Mesh(np.zeros((3, 3)), [[0, 1, 2]])], tmp_path / "a.png", Style(size=16))
    assert (tmp_path / "a.png").stat().st_size


def test_one_scale_of_colors_for_all_panels(tmp_path):
    """A mesh has the same colours wherever it stands, and a mesh with less error is lighter."""
    half = BALL.moved(0.9 * BALL.vertices + 0.1 * ROUGH.vertices)
    first = drawn(tmp_path / "a.png", [ROUGH, half], values="normal-error", reference=BALL)
    second = drawn(tmp_path / "b.png", [half, ROUGH], values="normal-error", reference=BALL)
    shown = Camera.looking_at(half), Camera.looking_at(ROUGH)
    assert shown[0].shows(ROUGH) and shown[1].shows(half)
    assert first[:100, :100].mean() < first[:100, 112:212].mean() - 10
    assert np.abs(first[20:80, 20:80].mean() - second[20:80, 132:192].mean()) < 3


def test_captions_have_the_mean_that_compare_measures(tmp_path):
    draw([ROUGH], tmp_path / "a.svg", Style(size=200, values="normal-error", reference=BALL), names=["rough"])
    mean = measure(ROUGH, BALL).normal_error_deg
    assert f">rough  mean {mean:#.3g}°</text>" in (tmp_path / "a.svg").read_text(encoding="utf-8")


def test_a_caption_has_no_mean_where_no_value_is_known(tmp_path, recwarn):
    one = Mesh(np.eye(3), [[0, 1, 2]])
    draw([one], tmp_path / "a.svg", Style(size=64, values="noise"), names=["one"])
    assert ">one</text>" in (tmp_path / "a.svg").read_text(encoding="utf-8") and not recwarn.list


def test_the_first_mesh_is_what_others_are_compared_with(tmp_path):
    picture = drawn(tmp_path / "a.png", [ROUGH, BALL], values="displacement")
    plain = drawn(tmp_path / "b.png", [ROUGH, BALL])
    assert (picture[:100, :100] == plain[:100, :100]).all()
    assert (picture[:100, 112:212] != plain[:100, 112:212]).any()


@pytest.mark.parametrize(
    ("values", "reference", "label"),
    [
        ("angle", None, "Angle to the input"),
        ("angle", BALL, "Angle to the reference"),
        ("normal-error", None, "Angle to the first mesh"),
        ("normal-error", BALL, "Angle to the reference"),
        ("distance", BALL, "Distance to the reference"),
    ],
)
def test_the_bar_names_the_mesh_that_values_are_measured_from(tmp_path, values, reference, label):
    draw([ROUGH, BALL], tmp_path / "a.svg", Style(size=64, values=values, reference=reference), names=["a", "b"])
    assert label in (tmp_path / "a.svg").read_text(encoding="utf-8")


def test_curvature_is_on_both_sides_of_grey(tmp_path):
    draw([BALL], tmp_path / "a.svg", Style(values="curvature", size=64))
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    numbers = [float(found.replace("−", "-")) for found in re.findall(r">(−?[\d.]+)</text>", text)]
    assert min(numbers) == -max(numbers) and max(numbers) >= 0.5 * np.abs(mean_curvature(BALL)).max()
    assert "Mean curvature (1 / mesh unit)" in text


def test_parts_are_enlarged_below_each_picture_in_frames_of_one_color(tmp_path):
    crops = [(0.5, 0.5, 0.2), (0.3, 0.6, 0.1)]
    picture = drawn(tmp_path / "a.png", [ROUGH, BALL], crops=crops)
    for number, color in enumerate(ACCENTS[:2]):
        alike = (np.abs(picture - list(bytes.fromhex(color[1:]))) < 3).all(axis=2)
        assert all(alike[rows, :100].any() and alike[rows, 112:].any() for rows in (slice(0, 100), slice(112, 160)))
        x, y, width = crops[number]
        rows, columns = np.nonzero(alike[:100, :100])
        assert (np.ptp(columns), np.ptp(rows)) == pytest.approx((100 * width, 100 * width), abs=3)
        assert (columns.mean(), rows.mean()) == pytest.approx((100 * x, 100 * y), abs=2)


def test_a_turntable_shows_every_side_once(tmp_path):
    flat = cube(2).moved(cube(2).vertices * (2, 1, 0.1))
    draw([flat], tmp_path / "t.webp", Style(size=64, direction=(0, 0, 1)), turntable=True)
    with PIL.Image.open(tmp_path / "t.webp") as image:
        assert image.n_frames == TURNS
        widths = []
        for number in range(0, TURNS, TURNS // 4):
            image.seek(number)
            dark = np.asarray(image.convert("L")) < 240
            widths.append(np.ptp(np.flatnonzero(dark[28:36].any(axis=0))))
    assert widths[0] == pytest.approx(widths[2], abs=2) and widths[1] == pytest.approx(widths[3], abs=2)
    assert widths[1] < 0.3 * widths[0]


def test_a_turntable_turns_around_the_target_at_the_distance(tmp_path):
    """A cube beside the target is seen at both sides of the middle, and half as large from twice as far."""
    box = cube(2).moved(cube(2).vertices * 0.1 + np.array([1.0, 0, 0]))
    places = []
    for number, distance in enumerate((4.0, 8.0)):
        style = Style(size=64, direction=(0, 0, 1), target=(0, 0, 0), distance=distance)
        draw([box], tmp_path / f"{number}.webp", style, names=[""], turntable=True)
        with PIL.Image.open(tmp_path / f"{number}.webp") as image:
            for frame in (0, TURNS // 2):
                image.seek(frame)
                places.append(np.flatnonzero((np.asarray(image.convert("L")) < 200).any(axis=0)).mean() - 31.5)
    assert places[0] == pytest.approx(-places[1], abs=2) and abs(places[0]) > 20
    assert places[2:] == pytest.approx([places[0] / 2, places[1] / 2], abs=2)


def test_a_target_and_a_distance_are_in_the_unit_of_the_file(tmp_path):
    """What lies at the target is in the middle, however large and far the mesh."""
    far = BALL.moved(512 * BALL.vertices + np.array([4096.0, 0, 0]))
    target = far.vertices[np.argmax(far.vertices[:, 2])]
    near = drawn(tmp_path / "a.png", [BALL], direction=(0, 0, 1), target=(0, 0, 1), distance=0.5)
    other = drawn(tmp_path / "b.png", [far], direction=(0, 0, 1), target=target, distance=256)
    assert np.abs(near - other).mean() < 1
    assert (near[:100].min(axis=2) < 250).all()


@pytest.mark.parametrize(
    ("style", "message"),
    [
        ({"values": "beauty"}, "values is 'beauty'; it must be one of"),
        ({"values": "normal-error"}, "compares a mesh with another one"),
        ({"limits": (2.0, 1.0)}, "limits is"),
        ({"crops": [(0.9, 0.5, 0.4)]}, "crop is"),
        ({"distance": -1.0}, "distance is"),
    ],
)
def test_senseless_styles_are_refused(style, message, tmp_path):
    with pytest.raises(ParameterError, match=message):
        draw([BALL], tmp_path / "a.png", Style(**style))
