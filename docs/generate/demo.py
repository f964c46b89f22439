"""Draw the pictures of README.md and of the site's first page: python docs/generate/demo.py

docs/demo.png is what `cascadenorm demo` draws. docs/split.png shows the same three meshes, the left half noisy and the
right half denoised by `auto`. Run it after the weights have changed.
"""

from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from cascadenorm.cli.demo import BEFORE_AFTER, EXAMPLES, Example, demo, draw
from cascadenorm.render import Camera, render

DOCS = Path(__file__).parents[1]
PANEL = (640, 640)
LINE = (176, 30, 99)
"""Colour of the line between the halves, as in the viewer of reports."""


def main() -> None:
    """Replace both pictures."""
    with TemporaryDirectory() as folder:
        examples = demo(folder)
        draw(examples, Path(folder))
        copyfile(Path(folder) / BEFORE_AFTER, DOCS / "demo.png")
    split = np.concatenate([halves(example) for example in examples], axis=1)
    Image.fromarray(split).quantize(256, dither=Image.Dither.NONE).save(DOCS / "split.png", optimize=True)


def halves(example: Example) -> np.ndarray:
    """Return a picture whose left half is the noisy mesh and whose right half is that of `auto`."""
    auto = next(outcome for outcome in example.denoised if outcome.method == "auto")
    view = Camera.looking_at(example.clean, direction=EXAMPLES[example.name])
    left, right = (render(one.mesh, view=view, size=PANEL) for one in (example.noisy, auto))
    middle = PANEL[0] // 2
    picture = np.concatenate([left[:, :middle], right[:, middle:]], axis=1)
    picture[:, middle - 1 : middle + 1] = LINE
    return picture


if __name__ == "__main__":
    main()
