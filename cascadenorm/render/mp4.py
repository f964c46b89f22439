"""MP4 files by the program ffmpeg, where the user has it: no encoder is shipped."""

import shutil
import subprocess
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import IO

from cascadenorm.errors import OutputError
from cascadenorm.render.color import Image

ENCODING = (
    *("-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"),  # even sides, as every player wants
    *("-q:v", "2"),  # for encoders other than x264, whose own default is good
    *("-threads", "1", "-fflags", "+bitexact", "-flags:v", "+bitexact", "-movflags", "+faststart"),
)


def require_ffmpeg() -> str:
    """Return where the program is.

    Raises
    ------
    OutputError
        It is not on the PATH.
    """
    found = shutil.which("ffmpeg")
    if found is None:
        raise OutputError(
            "an MP4 file needs the program ffmpeg, which is not on the PATH",
            hint="install it (https://ffmpeg.org), or give a name that ends in .webp",
        )
    return found


def mp4(images: Iterable[Image], *, milliseconds: int) -> bytes:
    """Return pictures as an MP4 file that shows one after the other.

    Parameters
    ----------
    images
        (height, width, 3) uint8 each, all of one size.
    milliseconds
        How long each is seen.

    Raises
    ------
    OutputError
        Ffmpeg is not installed, or fails.
    """
    program = require_ffmpeg()
    with TemporaryDirectory() as folder, TemporaryFile() as said:
        file = Path(folder, "turntable.mp4")  # not a pipe, as the index is moved to the front at the end
        code = _encode([program, "-loglevel", "error"], images, ["-r", f"1000/{milliseconds}"], file, said)
        if code:
            said.seek(0)
            last = said.read().decode(errors="replace").strip().rpartition("\n")[2]
            raise OutputError(f"{program} ended with {code}: {last or 'it says nothing'}")
        return file.read_bytes()


def _encode(program: list[str], images: Iterable[Image], rate: list[str], file: Path, said: IO[bytes]) -> int:
    """Pipe pictures into the program; return its exit code."""
    frames = iter(images)
    first = next(frames)
    height, width = first.shape[:2]
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", *rate, "-i", "-"]
    with subprocess.Popen([*program, *source, *ENCODING, str(file)], stdin=subprocess.PIPE, stderr=said) as running:
        assert running.stdin is not None
        try:
            with running.stdin as pipe:
                pipe.write(first.tobytes())
                for image in frames:
                    pipe.write(image.tobytes())
        except BrokenPipeError:
            pass  # it has ended, and its exit code says more
        except BaseException:
            running.kill()
            raise
    return running.wait()
