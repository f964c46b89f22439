"""Box plots as SVG."""

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from cascadenorm.render.panels import ticks

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Ends of the whiskers and of the box, and the line in it."""
WIDTH, ROW, LEFT, TOP = 720, 30, 170, 8
"""Lengths in pixels: of the plot, of a row, of the names, and of the margin."""


def box_plot(rows: Sequence[tuple[str, NDArray[np.float64]]], *, unit: str) -> str:
    """Draw a box for each row from the first to the third quartile, with whiskers from the 5th to the 95th percentile.

    Parameters
    ----------
    rows
        Names with their values, at least one value each.
    unit
        Unit of the values, written after the numbers of the axis.
    """
    spread = [np.quantile(values, QUANTILES) for _, values in rows]
    end = max(float(quantiles[-1]) for quantiles in spread) or 1.0
    bottom = TOP + ROW * len(rows)
    parts = []
    for value in ticks(0.0, end):
        x = _place(value, end)
        parts.append(f'<line class="grid" x1="{x:g}" x2="{x:g}" y1="{TOP}" y2="{bottom}"/>')
        parts.append(f'<text x="{x:g}" y="{bottom + 16}" text-anchor="middle">{value:g}{escape(unit)}</text>')
    for number, ((name, _), quantiles) in enumerate(zip(rows, spread, strict=True)):
        y = TOP + ROW * (number + 0.5)
        low, first, middle, third, high = (_place(float(value), end) for value in quantiles)
        parts += [
            f'<text x="{LEFT - 10}" y="{y + 4:g}" text-anchor="end">{escape(name)}</text>',
            f'<line x1="{low:g}" x2="{high:g}" y1="{y:g}" y2="{y:g}"/>',
            f'<rect x="{first:g}" y="{y - 8:g}" width="{max(third - first, 1):g}" height="16"/>',
            f'<line class="median" x1="{middle:g}" x2="{middle:g}" y1="{y - 8:g}" y2="{y + 8:g}"/>',
        ]
    medians = zip([name for name, _ in rows], [quantiles[2] for quantiles in spread], strict=True)
    about = "; ".join(f"{name}: median {median:.2f}{unit}" for name, median in medians)
    return (
        f'<svg class="boxes" viewBox="0 0 {WIDTH} {bottom + 24}" role="img" aria-label="{escape(about)}">'
        f"{''.join(parts)}</svg>"
    )


def _place(value: float, end: float) -> float:
    return LEFT + value / end * (WIDTH - LEFT - 20)
