"""Plots of an evaluation as HTML and SVG elements, in the colours of the page."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import ArrayLike

from cascadenorm.render import inline_svg
from cascadenorm.render.style import ACCENTS, INK, drawing

QUANTILES = {"whislo": 0.05, "q1": 0.25, "med": 0.5, "q3": 0.75, "whishi": 0.95}
"""Ends of the whiskers and of the box, and the line in it, as matplotlib calls them."""
PLOT_WIDTH, ROW, BESIDES = 720, 30, 80
"""Pixels: width of a plot, height of a row, and height of title and axis together."""
FONT_SIZE = 13
"""Size of the text in pixels."""


def bar_chart(rows: Sequence[tuple[str, float]], *, unit: str) -> str:
    """Return a bar for each name and value, at least 0, with its unit; the lowest first and in the accent colour."""
    lowest, largest = (found((value for _, value in rows), default=0.0) for found in (min, max))
    bars = []
    for name, value in sorted(rows, key=lambda row: row[1]):
        kind = ' class="best"' if value == lowest else ""
        bar = f'<dd><i{kind} style="width: {100 * value / (largest or 1.0):.1f}%"></i></dd>'
        bars.append(f"<dt>{escape(name)}</dt>{bar}<dd>{value:.2f}{escape(unit)}</dd>")
    return f'<dl class="bars-of">{"".join(bars)}</dl>'


def box_plot(rows: Mapping[str, ArrayLike], *, title: str, label: str) -> str:
    """Draw the distribution of values, one row each: boxes span the quartiles, whiskers the 5th to 95th percentile.

    `rows` has the values, at least one, of each name. The label is the name and unit of the values.
    """
    boxes = [
        {name: float(np.quantile(np.asarray(values), share)) for name, share in QUANTILES.items()}
        for values in rows.values()
    ]
    medians = [f"{name}: median {box['med']:.2f}" for name, box in zip(rows, boxes, strict=True)]
    names = [name.replace("\n", " ") for name in rows]
    with drawing("".join([*names, title, label])):
        from matplotlib.figure import Figure

        size = PLOT_WIDTH / 72, (BESIDES + ROW * len(names)) / 72
        figure = Figure(size, dpi=72, layout="constrained")  # a point is a pixel
        axes = figure.subplots()
        axes.bxp(
            boxes,
            positions=range(len(boxes)),
            widths=0.5,
            orientation="horizontal",
            showfliers=False,
            showcaps=False,
            patch_artist=True,
            boxprops={"facecolor": INK, "alpha": 0.35, "linewidth": 0},
            whiskerprops={"color": INK},
            medianprops={"color": ACCENTS[0], "linewidth": 2.5},
        )
        axes.set_title(title, size=FONT_SIZE, loc="left")
        axes.set_xlabel(label, size=FONT_SIZE)
        axes.set_yticks(range(len(names)), names)
        axes.tick_params(labelsize=FONT_SIZE, length=0)
        axes.set(xlim=(0, None), ylim=(len(names) - 0.5, -0.5))
        axes.grid(axis="x", color=INK, alpha=0.2)
        axes.spines[:].set_visible(False)
        axes.patch.set_visible(False)
    return inline_svg(figure, f"{title}. {'; '.join(medians)}")
