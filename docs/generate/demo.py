"""Draw the pictures of README.md and of the site's first page: python docs/generate/demo.py

docs/demo.png is what `cascadenorm demo` draws. docs/split.png shows the same three meshes, the left half noisy and the
right half denoised by `auto`. Run it after the weights have changed.
"""

from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from cascadenorm.cli.demo import BEFORE_AFTER, EXAMPLES, demo, draw_demo, example_meshes
from cascadenorm.mesh import Mesh
from cascadenorm.render import Camera, render

DOCS = Path(__file__).parents[1]
PANEL = (640, 640)
LINE = (176, 30, 99)
"""Colour of the line between the halves, as in the viewer of reports."""


def main() -> None:
    """Replace both pictures."""
    with TemporaryDirectory() as folder:
        done = demo(folder)
        draw_demo(done, Path(folder))
        copyfile(Path(folder) / BEFORE_AFTER, DOCS / "demo.png")
        split = np.concatenate([halves(pair.name, *example_meshes(done, pair)) for pair in done.pairs], axis=1)
    Image.fromarray(split).quantize(256, dither=Image.Dither.NONE).save(DOCS / "split.png", optimize=True)


def halves(name: str, noisy: Mesh, *others: Mesh) -> np.ndarray:
    """Return a picture whose left half is the noisy mesh and whose right half is that of `auto`, the last method."""
    *_, auto, clean = others
    view = Camera.looking_at(clean, direction=EXAMPLES[name])
    left, right = (render(mesh, view=view, size=PANEL) for mesh in (noisy, auto))
    middle = PANEL[0] // 2
    picture = np.concatenate([left[:, :middle], right[:, middle:]], axis=1)
    picture[:, middle - 1 : middle + 1] = LINE
    return picture


if __name__ == "__main__":
    main()
