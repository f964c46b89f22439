"""What evaluations are tested on."""

import shlex
import sys
from pathlib import Path

from shapes import cube, icosphere, noisy

from cascadenorm.io.interop import save_mesh

SHAPES = {"ball": icosphere(2), "cube": cube(4)}
COPY = (
    "import sys, shutil; shutil.copyfile(*sys.argv[1:]); x = bytearray(120_000_000); x[::4096] = b'1' * len(x[::4096])"
)


def python(code):
    """The command line of a program that gets both names of files."""
    return f"{sys.executable} -c {shlex.quote(code)} {{in}} {{out}}"


def save_pairs(root: Path) -> Path:
    """Write a pair of each shape and a folder without any; return the folder of all."""
    for name, clean in SHAPES.items():
        (root / name).mkdir()
        save_mesh(root / name / "noisy.ply", noisy(clean, 0.2))
        save_mesh(root / name / "clean.ply", clean)
    (root / "notes").mkdir()
    return root
