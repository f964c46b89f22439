"""Bars that compare methods, as HTML that follows the width and the colours of the page."""

from collections.abc import Sequence
from html import escape


def overview(rows: Sequence[tuple[str, float]], *, unit: str) -> str:
    """Return a bar for each name and value, at least 0, with its unit; the lowest first and in the accent colour."""
    lowest, largest = (found((value for _, value in rows), default=0.0) for found in (min, max))
    bars = []
    for name, value in sorted(rows, key=lambda row: row[1]):
        kind = ' class="best"' if value == lowest else ""
        bar = f'<dd><i{kind} style="width: {100 * value / (largest or 1.0):.1f}%"></i></dd>'
        bars.append(f"<dt>{escape(name)}</dt>{bar}<dd>{value:.2f}{escape(unit)}</dd>")
    return f'<dl class="bars-of">{"".join(bars)}</dl>'
