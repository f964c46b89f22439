"""Encode images as PNG and WebP with Pillow, and as MP4 with the user's ffmpeg, since no encoder is shipped."""

import io
import shutil
import subprocess
from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile

import PIL.Image

from cascadenorm.errors import OutputError
from cascadenorm.render.color import Image

MP4_SETTINGS = (
    *("-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"),  # even sides, for all players
    *("-q:v", "2"),  # for encoders other than x264, which has a good default
    *("-threads", "1", "-fflags", "+bitexact", "-flags:v", "+bitexact", "-movflags", "+faststart"),
)


def png(image: Image, *, dpi: int | None = None) -> bytes:
    """Encode an image as PNG with 8 bits per channel, and optionally its resolution in pixels per inch."""
    file = io.BytesIO()
    settings = {} if dpi is None else {"dpi": (dpi, dpi)}
    PIL.Image.fromarray(image).save(file, "PNG", **settings)
    return file.getvalue()


def webp(image: Image) -> bytes:
    """Encode an image as WebP with hardly visible losses."""
    file = io.BytesIO()
    PIL.Image.fromarray(image).save(file, "WEBP", quality=85)
    return file.getvalue()


def animated_webp(images: Iterable[Image], *, milliseconds: int) -> bytes:
    """Encode images as a WebP animation that repeats indefinitely."""
    first, *others = map(PIL.Image.fromarray, images)
    file = io.BytesIO()
    first.save(file, "WEBP", save_all=True, append_images=others, duration=milliseconds, loop=0, quality=80)
    return file.getvalue()


def require_ffmpeg() -> str:
    """Return the path of ffmpeg. Raises OutputError if it is not on the PATH."""
    found = shutil.which("ffmpeg")
    if found is None:
        raise OutputError(
            "an MP4 file needs the program ffmpeg, which is not on the PATH",
            hint="install it (https://ffmpeg.org), or give a name that ends in .webp",
        )
    return found


def mp4(images: Iterable[Image], *, milliseconds: int) -> bytes:
    """Encode images, (height, width, 3) uint8 of equal size, as an MP4 video that shows each for a time.

    Raises OutputError if ffmpeg is not installed or fails.
    """
    program, frames = require_ffmpeg(), iter(images)
    first = next(frames)
    height, width = first.shape[:2]
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"1000/{milliseconds}", "-i", "-"]
    with TemporaryDirectory() as folder, TemporaryFile() as said:
        file = Path(folder, "turntable.mp4")  # not a pipe, because the index is moved to the front at the end
        command = [program, "-loglevel", "error", *source, *MP4_SETTINGS, str(file)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=said) as running:
            assert running.stdin is not None
            try:
                with running.stdin as pipe:
                    pipe.writelines(image.tobytes() for image in chain([first], frames))
            except BrokenPipeError:
                pass  # the program has ended, and its exit code is more informative
            except BaseException:
                running.kill()
                raise
        if running.returncode:
            said.seek(0)
            last = said.read().decode(errors="replace").strip().rpartition("\n")[2]
            raise OutputError(f"{program} ended with {running.returncode}: {last or 'it says nothing'}")
        return file.read_bytes()
