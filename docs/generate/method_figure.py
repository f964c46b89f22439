"""Draw the figure of docs/method.md: one stage of `cascade` on the machine part of the demonstration.

python docs/generate/method_figure.py [--output FILE]
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cascadenorm.io.atomic import write_atomically
from cascadenorm.io.interop import as_mesh
from cascadenorm.learned.descriptors import SIGMA_R, SIGMA_S, bilateral_descriptor
from cascadenorm.learned.methods import shipped
from cascadenorm.learned.packed_normals import unpacked
from cascadenorm.learned.regression import nearest, stage_stack
from cascadenorm.mesh import angles_between
from cascadenorm.render import Camera, Panel, montage, pixels, png, render

ROOT = Path(__file__).parents[2]
PART = ROOT / "cascadenorm" / "demo_data" / "part"
DIRECTION = (0.45, 0.4, 0.8)
PANEL = (360, 360)
CLUSTER_COLORS = np.array([[0.00, 0.45, 0.70], [0.90, 0.62, 0.00], [0.00, 0.62, 0.45], [0.80, 0.47, 0.65]])
"""Okabe and Ito's palette, which colour-blind readers tell apart."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the panels and write them as one picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "method.png")
    output = parser.parse_args(arguments).output

    # The first stage, step by step
    noisy, clean = as_mesh(PART / "noisy.ply"), as_mesh(PART / "clean.ply")
    model = shipped("cascade")
    stage = model.stages[0]
    stack = stage_stack(stage.settings, noisy, noisy)
    context = stage.scaler.context(stack, noisy).of()
    cluster = nearest(stage.scaler.features(unpacked(stack), context), stage.centers)
    bilateral = bilateral_descriptor(noisy)
    normals = stage.normals(noisy, stack)
    first, *_, last = model.steps(noisy)

    # Fields of normals are drawn on the clean mesh: the light on the noisy one would hide them
    view = Camera.looking_at(clean, direction=DIRECTION)

    def field(values):  # type: ignore[no-untyped-def]
        return render(clean, view=view, size=PANEL, colors=0.5 + 0.5 * values)

    def filtered(sigma_s, sigma_r):  # type: ignore[no-untyped-def]
        number = len(SIGMA_R) * SIGMA_S.index(sigma_s) + SIGMA_R.index(sigma_r)
        return field(bilateral[:, number].astype(np.float64))

    def off(mesh):  # type: ignore[no-untyped-def]
        return f"{np.degrees(angles_between(mesh.face_normals, clean.face_normals)).mean():.1f}°"

    rows = [
        [
            (f"noisy mesh: {off(noisy)}", render(noisy, view=view, size=PANEL)),
            ("face normals", field(noisy.face_normals)),
            ("narrow bilateral filter", filtered(1.0, 0.2)),
            ("wide bilateral filter", filtered(2.0, 0.5)),
        ],
        [
            ("clusters", render(clean, view=view, size=PANEL, colors=CLUSTER_COLORS[cluster])),
            ("regressed normals", field(normals)),
            (f"vertices, stage 1: {off(first)}", render(first, view=view, size=PANEL)),
            (f"vertices, stage {len(model.stages)}: {off(last)}", render(last, view=view, size=PANEL)),
        ],
    ]
    figure = montage([[Panel(picture, caption) for caption, picture in row] for row in rows])
    write_atomically(output, [png(pixels(figure))], force=True)


if __name__ == "__main__":
    main()
