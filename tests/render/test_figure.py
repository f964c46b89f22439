"""Figures of several panels: pixels at their places, text that fits, and the files."""

import re
import warnings
from base64 import b64decode
from xml.etree import ElementTree

import numpy as np
import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from matplotlib import font_manager
from shapes import cube

from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.render import Bar, Inset, Panel, color_map, inline_row, inline_svg, montage, pixels
from cascadenorm.render import style as styles
from cascadenorm.render.figure import ACCENTS, GAP, pdf, svg

SIZES = [(40, 30), (61, 37), (100, 100), (99, 213)]


def picture(height, width, channels=3):
    return np.random.default_rng(height).integers(0, 255, (height, width, channels), np.uint8)


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


@pytest.fixture
def fonts(tmp_path, monkeypatch):
    """This machine with only the fonts that come with matplotlib, and one with two characters."""
    glyphs, outlines = {".notdef": 100, "first": 400, "second": 800}, {}
    for name, height in glyphs.items():
        pen = TTGlyphPen(None)
        for place, point in enumerate([(0, 0), (0, height), (800, height), (800, 0)]):
            (pen.lineTo if place else pen.moveTo)(point)
        pen.closePath()
        outlines[name] = pen.glyph()
    builder = FontBuilder(1000)
    builder.setupGlyphOrder(list(glyphs))
    builder.setupCharacterMap({ord("名"): "first", ord("前"): "second"})
    builder.setupGlyf(outlines)
    builder.setupHorizontalMetrics(dict.fromkeys(glyphs, (900, 0)))
    builder.setupHorizontalHeader(ascent=800, descent=-200)
    builder.setupNameTable({"familyName": "Two Squares", "styleName": "Regular", "psName": "TwoSquares"})
    builder.setupOS2(sTypoAscender=800)
    builder.setupPost()
    builder.save(tmp_path / "squares.ttf")
    manager = font_manager.fontManager
    monkeypatch.setattr(manager, "ttflist", [one for one in manager.ttflist if "matplotlib" in one.fname])
    styles._fonts.cache_clear()
    yield tmp_path / "squares.ttf"
    styles._fonts.cache_clear()


def test_a_character_that_the_usual_font_lacks_is_drawn_by_another_one(fonts):
    font_manager.fontManager.addfont(fonts)
    figure = montage([[Panel(picture(200, 200), "a名前")]])
    ink = 255 - pixels(figure)[200:, :, 0].astype(int)
    assert styles.fonts("a名") == ([styles.FONT, "Two Squares"], "")
    columns = np.count_nonzero(ink > 200, axis=0)
    size = 18  # pixels
    assert [np.count_nonzero(columns >= height * size - 2) for height in (0.4, 0.8)] == pytest.approx([29, 14], abs=3)
    assert b"Two Squares" in svg(figure) and b"+TwoSquares" in pdf(figure)


def test_characters_that_no_font_has_are_named_once(fonts, recwarn):
    figure = montage([[Panel(picture(200, 200), "a名前b")]])
    with pytest.warns(UserWarning, match=r"no font on this machine has 前 \(U\+524D\), 名 \(U\+540D\)") as said:
        pixels(figure)
    assert len(said) == 1
    assert "a名前b".encode() in svg(figure)  # whoever opens it may have a font
    assert not recwarn.list


def test_the_users_own_settings_of_matplotlib_change_nothing():
    import matplotlib

    rows = [[Panel(picture(60, 60), "caption")]]
    usual = pixels(montage(rows)), svg(montage(rows)), pdf(montage(rows))
    with matplotlib.rc_context({"font.size": 30, "text.color": "red", "figure.dpi": 50, "svg.fonttype": "path"}):
        figure = montage(rows)
        assert (pixels(figure) == usual[0]).all() and (svg(figure), pdf(figure)) == usual[1:]


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


def test_the_command_line_names_characters_that_no_font_has(fonts, tmp_path, capsys):
    save_mesh(tmp_path / "名.ply", cube(1))
    assert run(["render", str(tmp_path / "名.ply"), "-o", str(tmp_path / "a.png"), "--size", "64"]) == 0
    assert "warning: no font on this machine has 名 (U+540D)" in capsys.readouterr().err
