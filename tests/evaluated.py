"""What evaluations are tested on."""

import shlex
import sys

from shapes import cube, icosphere

SHAPES = {"ball": icosphere(2), "cube": cube(4)}
COPY = (
    "import sys, shutil; shutil.copyfile(*sys.argv[1:]); x = bytearray(120_000_000); x[::4096] = b'1' * len(x[::4096])"
)


def python(code):
    """The command line of a program that gets both names of files."""
    return f"{sys.executable} -c {shlex.quote(code)} {{in}} {{out}}"
