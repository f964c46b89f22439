"""Settings of matplotlib, with fonts for any text in a figure."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 300  # pixels per inch
INK = "#333842"
"""Colour of text and lines."""
ACCENTS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7")
"""Colours that colour-blind readers can distinguish (Okabe and Ito 2008)."""
FONT = "DejaVu Sans"  # font shipped with matplotlib, which covers Latin, Greek, Cyrillic and more
FIGURE_SETTINGS = {
    "figure.dpi": DPI,
    "savefig.dpi": "figure",
    "text.parse_math": False,  # keep dollar signs in file names
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.edgecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "svg.fonttype": "none",
    "svg.hashsalt": "cascadenorm",  # reproducible names in every run
    "pdf.fonttype": 42,
}


@contextmanager
def drawing(text: str) -> Iterator[None]:
    """Configure matplotlib for a figure with the given text, independently of the user's settings."""
    from matplotlib import style

    settings = {**FIGURE_SETTINGS, "font.family": [*fonts(text)[0], "sans-serif"], "font.sans-serif": FONT}
    with style.context(["default", settings]), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)  # fonts() reports these
        yield


def text_of(figure: "Figure") -> str:
    from matplotlib.text import Text

    return "".join(text.get_text() for text in figure.findobj(Text))


def warn_of_missing(text: str) -> None:
    """Warn about characters that no font on this machine has."""
    missing = fonts(text)[1]
    if missing:
        names = ", ".join(f"{character} (U+{ord(character):04X})" for character in missing)
        problem = f"no font on this machine has {names}; boxes are drawn instead"
        warnings.warn(f"{problem}: install a font such as Noto Sans, or write an SVG file", stacklevel=3)


def fonts(text: str) -> tuple[list[str], str]:
    """Return names of fonts that together cover a text, and the characters that no font has."""
    return _fonts(frozenset(filter(str.isprintable, text)))


@cache
def _fonts(characters: frozenset[str]) -> tuple[list[str], str]:
    from matplotlib.font_manager import FontProperties, findfont, fontManager, get_font

    plain = [one for one in fontManager.ttflist if (one.style, one.weight, one.stretch) == ("normal", 400, "normal")]
    others = {one.name for one in plain if not one.name.startswith("Last Resort")} - {FONT}  # a font of boxes
    names: list[str] = []
    missing = set(characters)
    for name in [FONT, *sorted(others, key=lambda name: ("Sans" not in name, name))]:
        if names and not missing:
            break
        known = {chr(code) for code in get_font(findfont(FontProperties(family=[name]))).get_charmap()}
        if name == FONT or known & missing:
            names.append(name)
            missing -= known
    return names, "".join(sorted(missing))
