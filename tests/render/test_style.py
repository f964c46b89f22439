"""Text is drawn in fonts that have its characters, whatever the user's own settings of matplotlib."""

import numpy as np
import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from matplotlib import font_manager
from pictures import picture
from shapes import cube

from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.render import Panel, montage, pixels
from cascadenorm.render import style as styles
from cascadenorm.render.figure import pdf, svg


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


def test_the_command_line_names_characters_that_no_font_has(fonts, tmp_path, capsys):
    save_mesh(tmp_path / "名.ply", cube(1))
    assert run(["render", str(tmp_path / "名.ply"), "-o", str(tmp_path / "a.png"), "--size", "64"]) == 0
    assert "warning: no font on this machine has 名 (U+540D)" in capsys.readouterr().err
