"""Pictures read back, and how the tests have them drawn."""

import io
import shutil
import subprocess

import numpy as np
import PIL.Image
import pytest

from cascadenorm.render import Camera
from cascadenorm.render.files import draw
from cascadenorm.render.scenes import Style


def decoded(data):
    """Read a PNG back."""
    with PIL.Image.open(io.BytesIO(data)) as image:
        assert (image.format, image.mode) == ("PNG", "RGB")
        return np.asarray(image)


def decoded_size(path):
    with PIL.Image.open(path) as image:
        return image.size


def video_of(path):
    """The frames of a video, and the format of its pixels."""
    read = ["ffmpeg", "-loglevel", "error", "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    probe = ["ffprobe", "-v", "error", "-count_frames", "-show_entries", "stream=width,height,pix_fmt,nb_read_frames"]
    said = subprocess.run([*probe, "-of", "csv=p=0", str(path)], capture_output=True, check=True, text=True)
    width, height, pixels, count = said.stdout.strip().split(",")
    data = subprocess.run(read, capture_output=True, check=True).stdout
    frames = np.frombuffer(data, np.uint8).reshape(int(count), int(height), int(width), 3)
    return frames.astype(int), pixels


needs_ffmpeg = pytest.mark.skipif(not shutil.which("ffmpeg"), reason="needs the program ffmpeg")


def parallel(mesh, direction=(0, 0, 1)):
    return Camera.looking_at(mesh, direction=direction, perspective=0)


def black(mesh):
    return np.zeros((len(mesh.faces), 3))


def drawn(path, meshes, **style):
    """The pixels of a PNG file of meshes."""
    draw(meshes, path, Style(size=100, **style), force=True)
    return decoded(path.read_bytes()).astype(int)


def picture(height, width, channels=3):
    return np.random.default_rng(height).integers(0, 255, (height, width, channels), np.uint8)
