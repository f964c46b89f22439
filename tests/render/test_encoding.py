"""Encoded pictures and videos decode to the pixels that were given, in their order."""

import io
import sys

import numpy as np
import PIL.Image
import pytest
from pictures import decoded, needs_ffmpeg, video_of
from shapes import cube, icosphere, noisy

from cascadenorm.io import OutputError
from cascadenorm.render import png, render, webp
from cascadenorm.render.encoding import mp4
from cascadenorm.render.files import draw
from cascadenorm.render.scenes import Style

BALL = icosphere(3)


def test_a_webp_decodes_to_nearly_the_same_pixels():
    image = render(noisy(icosphere(2), 0.3), size=(61, 47))
    data = webp(image)
    with PIL.Image.open(io.BytesIO(data)) as read:
        assert np.abs(np.asarray(read.convert("RGB")).astype(int) - image).mean() < 5
    assert webp(image) == data


def test_a_png_decodes_to_the_same_pixels():
    image = render(noisy(icosphere(2), 0.3), size=(61, 47))
    assert (decoded(png(image)) == image).all()


@needs_ffmpeg
def test_an_mp4_file_has_the_pictures_in_their_order(tmp_path):
    """Sides are even, as H.264 wants them: 33 and 65 pixels become 34 and 66."""
    images = [np.full((33, 65, 3), 200, np.uint8) for _ in range(8)]
    for number, image in enumerate(images):
        image[:, 8 * number : 8 * number + 8] = 40
    data = mp4(images, milliseconds=60)
    assert data == mp4(iter(images), milliseconds=60)
    (tmp_path / "a.mp4").write_bytes(data)
    frames, pixels = video_of(tmp_path / "a.mp4")
    assert pixels == "yuv420p" and frames.shape == (8, 34, 66, 3)
    for frame, image in zip(frames, images, strict=True):
        assert np.abs(frame[:33, :65] - image.astype(int)).mean() < 8


def test_an_mp4_file_needs_ffmpeg_and_says_what_that_says(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OutputError, match=r"needs the program ffmpeg, .* or give a name that ends in \.webp"):
        draw([BALL], tmp_path / "t.mp4", turntable=True)
    if sys.platform != "win32":
        (tmp_path / "ffmpeg").write_text("#!/bin/sh\necho Unknown encoder >&2\nexit 8\n")
        (tmp_path / "ffmpeg").chmod(0o755)
        with pytest.raises(OutputError, match="ffmpeg ended with 8: Unknown encoder"):
            draw([cube(2)], tmp_path / "t.mp4", Style(size=32), turntable=True)
    assert not (tmp_path / "t.mp4").exists()
