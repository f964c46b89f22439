"""Files with pictures of several meshes."""

import io
import re
from base64 import b64decode

import numpy as np
import PIL.Image
import pytest
from pictures import drawn, needs_ffmpeg, video_of
from shapes import cube, icosphere, noisy

from cascadenorm.io import OutputError
from cascadenorm.render.files import draw
from cascadenorm.render.scenes import FRAMES as TURNS
from cascadenorm.render.scenes import Style

BALL = icosphere(3)
ROUGH = noisy(BALL, 0.3)


def test_vector_files_hold_the_same_pixels_and_text_as_text(tmp_path):
    style, picture = Style(size=100, crops=[(0.5, 0.5, 0.2)]), drawn(tmp_path / "a.png", [ROUGH, BALL])[:100, :100]
    for suffix in ("svg", "pdf"):
        draw([ROUGH, BALL], tmp_path / f"a.{suffix}", style, names=["a (one)", "ball"])
    text = (tmp_path / "a.svg").read_text(encoding="utf-8")
    with PIL.Image.open(io.BytesIO(b64decode(re.search(r"base64,([^\"]+)", text)[1]))) as image:
        first = np.asarray(image.convert("RGB"))
    assert (first == picture).all() and ">a (one)</text>" in text and text.count("<image") == 4
    data = (tmp_path / "a.pdf").read_bytes()
    sides = sorted(re.findall(rb"/Width (\d+) /Height (\d+)", re.sub(rb"\s+", b" ", data)))
    assert (
        data.startswith(b"%PDF-") and b"/FontFile2" in data and sides == 2 * [(b"100", b"100")] + 2 * [(b"100", b"100")]
    )


def test_a_png_says_how_large_it_is_and_may_be_transparent(tmp_path):
    draw([BALL], tmp_path / "a.png", Style(size=64, transparent=True, values="noise"), names=["ball"])
    with PIL.Image.open(tmp_path / "a.png") as image:
        assert image.mode == "RGBA" and image.info["dpi"] == pytest.approx((300, 300), abs=0.1)
        pixels = np.asarray(image)
    assert pixels[0, 0, 3] == 0 and pixels[32, 32, 3] == 255 and 0 < pixels[64:, :, 3].mean() < 200


@needs_ffmpeg
def test_a_turntable_may_be_an_mp4_file(tmp_path):
    """It has no transparency."""
    flat = cube(2).moved(cube(2).vertices * (2, 1, 0.1))
    style = Style(size=32, direction=(0, 0, 1), transparent=True)
    draw([flat], tmp_path / "t.mp4", style, names=[""], turntable=True)
    frames, _ = video_of(tmp_path / "t.mp4")
    assert len(frames) == TURNS and frames[:, 0, 0].min() > 245
    widths = [np.ptp(np.flatnonzero((frame[14:18] < 230).any(axis=(0, 2)))) for frame in frames[:: TURNS // 4]]
    assert widths[1] < 0.4 * widths[0] and widths[2] > 0.8 * widths[0]


def test_names_of_other_kinds_are_refused(tmp_path):
    with pytest.raises(OutputError, match=r"give a name that ends in \.png, \.webp, \.svg, \.pdf"):
        draw([BALL], tmp_path / "a.gif")
    with pytest.raises(OutputError, match=r"ends in \.webp, \.mp4"):
        draw([BALL], tmp_path / "a.gif", turntable=True)
