"""Figures of several panels: pixels at their places, text that fits, and the files."""

import re
import warnings
from base64 import b64decode
from xml.etree import ElementTree

import numpy as np
import pytest
from pictures import decoded_size, picture
from shapes import icosphere

from cascadenorm.render import Bar, Inset, Panel, color_map, inline_row, inline_svg, montage, pixels
from cascadenorm.render import style as styles
from cascadenorm.render.figure import ACCENTS, GAP
from cascadenorm.render.files import draw
from cascadenorm.render.scenes import Style

SIZES = [(40, 30), (61, 37), (100, 100), (99, 213)]
BALL = icosphere(3)


def colored(image, color):
    """Where a picture has nearly a colour."""
    return (np.abs(image.astype(int) - [int(color[i : i + 2], 16) for i in (1, 3, 5)]) < 40).all(axis=2)


def captioned(figure):
    """The captions of a figure as they are drawn."""
    return [text.get_text() for text in figure.axes[0].texts]


@pytest.mark.parametrize("transparent", [False, True])
def test_panels_keep_their_pixels_and_captions_stand_below(transparent):
    images = [picture(*size) for size in SIZES]
    drawn = pixels(montage([[Panel(image) for image in images], [Panel(images[0], "ab")]]), transparent=transparent)
    assert drawn.shape[1] == sum(width + GAP for _, width in SIZES) - GAP
    left = 0
    for image in images:
        height, width, _ = image.shape
        assert (drawn[:height, left : left + width, :3] == image).all()
        left += width + GAP
    second = drawn[100 + GAP :]
    assert (second[:40, :30, :3] == images[0]).all()
    below = second[40:, :30]
    assert (below[..., 3] > 200).any() if transparent else (below < 200).any()
    assert not second[..., 3][:, 40:].any() if transparent else (second[:, 40:] == 255).all()


def test_a_transparent_picture_stays_transparent():
    image = picture(50, 50, 4)
    image[..., 3] = 255 * (np.arange(50) > 20)
    drawn = pixels(montage([[Panel(image)]]), transparent=True)
    assert (drawn[:, :21, 3] == 0).all() and (drawn[:, 21:] == image[:, 21:]).all()
    assert (pixels(montage([[Panel(image)]]))[:, :21] == 255).all()


def test_the_bar_has_the_color_of_each_mark_beside_it():
    figure = montage([[Panel(np.full((300, 300, 3), 255, np.uint8))]], bar=Bar("Angle (°)", (0.0, 30.0)))
    image = pixels(figure)[..., :3]
    axes = figure.axes[1]
    column = int(figure.bbox.width * axes.get_position().x0) + 6
    marks = axes.get_yticks()
    assert {0.0, 10.0, 20.0, 30.0} <= set(marks) and axes.get_ylabel() == "Angle (°)"
    for mark in marks[1:-1]:
        row = len(image) - axes.transData.transform((0, mark))[1]
        assert np.abs(image[int(row), column] - 255 * color_map(signed=False)[round(255 * mark / 30)]).max() < 12


def test_enlarged_parts_are_framed_in_both():
    white = np.full((100, 100, 3), 255, np.uint8)
    drawn = pixels(
        montage([[Panel(white, "", [Inset(0.5, 0.4, 0.2, white[:50, :50]), Inset(0.2, 0.2, 0.1, white[:30])])]])
    )
    for color, (x, y, side) in zip(ACCENTS, [(50, 40, 20), (20, 20, 10)], strict=False):
        rows, columns = np.nonzero(colored(drawn[:100], color))
        assert (np.ptp(columns), np.ptp(rows)) == pytest.approx((side, side), abs=3)
        assert (columns.mean(), rows.mean()) == pytest.approx((x, y), abs=1.5)
        assert colored(drawn[100:], color).sum() > 50


@pytest.mark.parametrize("name", ["two\nlines", "\udcff", "\0", "\t", "a$b$c", "шум", "عربي", "a" * 250 + ".ply"])
def test_any_name_of_a_file_is_a_caption_of_one_line_in_its_room(name):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        figure = montage([[Panel(picture(200, 200), name), Panel(picture(200, 200))]])
        drawn = 255 - pixels(figure)[200:].astype(int)
    assert not said
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in ((1, 2), (0, 2)))
    assert 0 < np.ptp(rows) < 25 and columns[-1] < 200
    (line, _) = captioned(figure)
    if len(name) > 200:
        assert re.fullmatch(r"a+…a+\.ply", line)
    elif name.isprintable():
        assert line == name


def test_a_figure_in_a_page_has_the_colors_of_the_page():
    image = picture(60, 60, 4)
    element = inline_svg(montage([[Panel(image, "a<b>")]], bar=Bar("Angle (°)", (0.0, 1.0))), 'one "figure"')
    assert element.startswith('<svg role="img" aria-label="one &quot;figure&quot;"') and element.endswith("</svg>\n")
    assert "fill: currentColor" in element and styles.INK not in element and "#ffffff" not in element
    assert "a&lt;b&gt;</text>" in element and not re.findall(r'\bid="figure', element)
    (data,) = _pictures(element)[:1]
    assert b64decode(data)[8:12] == b"WEBP"
    clips = set(re.findall(r"url\(#(\w+)\)", element))
    assert clips and clips <= set(re.findall(r'id="(\w+)"', element))


def test_a_row_of_pictures_in_a_page_is_laid_out_like_a_figure():
    rows = [Panel(picture(60, 60, 4), "a<b>"), Panel(picture(80, 80, 4), "two")]
    row, figure = inline_row(rows, 'one "row"'), inline_svg(montage([rows]), 'one "row"')
    assert row.startswith('<svg role="img" aria-label="one &quot;row&quot;"') and row.endswith("</svg>")
    assert re.findall(r">([^<]+)</text>", row) == ["a&lt;b&gt;", "two"] == re.findall(r">([^<]+)</text>", figure)
    assert _pictures(row) == _pictures(figure)
    sides = [float(side) for text in (row, figure) for side in re.findall(r'viewBox="0 0 (\S+) (\S+)"', text)[0]]
    assert sides[0] / sides[1] == pytest.approx(sides[2] / sides[3], rel=1e-4)
    elements = ElementTree.fromstring(row)
    assert [float(one.get("x") or 0) for one in elements if one.tag.endswith("image")] == [0, 72]


def _pictures(element: str) -> list[str]:
    return re.findall(r"data:image/webp;base64,([^\"]+)", element.replace("\n", ""))


@pytest.mark.parametrize("size", [16, 32])
def test_a_small_picture_has_a_color_bar(tmp_path, size):
    draw([BALL], tmp_path / "a.png", Style(size=size, values="curvature"), names=[""])
    assert decoded_size(tmp_path / "a.png") > (size, size)
