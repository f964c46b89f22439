"""Captions: an alphabet of round strokes, drawn at any size without a font file."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

# Each glyph is a few paths over a grid: two digits a point, x then y; the baseline is y = 2, small letters reach 6,
# capitals 8, tails 0. '~' rounds the corners of a path, 'o' closes and rounds it.
_BOWL = "o02424606"
_GLYPHS = {
    "a": f"{_BOWL} 4642", "b": f"{_BOWL} 0802", "c": "~454606024243", "d": f"{_BOWL} 4842", "e": "0444 ~444606024243",
    "f": "~381816 1612 0636", "g": f"{_BOWL} 4642 ~424000", "h": "0802 ~04064644 4442", "i": "0602 0808",
    "j": "1611 ~111000 1818", "k": "0802 0336 1432", "l": "0803 ~030212", "m": "0602 ~04063634 3432 ~34366664 6462",
    "n": "0602 ~04064644 4442", "o": _BOWL, "p": f"{_BOWL} 0600", "q": f"{_BOWL} 4640", "r": "0602 ~040636",
    "s": "~4546060444420203", "t": "1813 ~131232 0636", "u": "0604 ~04024244 4642", "v": "062246", "w": "0612355266",
    "x": "0642 0246", "y": "0622 4610", "z": "06460242",
    "A": "023862 1454", "B": "28080222 ~28484525 2505 ~25454222",
    "C": "~575808025253", "D": "18080212 ~18585212", "E": "48080242 0535", "F": "480802 0535",
    "G": "~575808025254 545535", "H": "0802 4842 0545", "I": "0802", "J": "3834 ~34320203", "K": "0802 0448 1542",
    "L": "080242", "M": "0208346862", "N": "02085258", "O": "o02525808", "P": "020828 ~28484525 2505",
    "Q": "o02525808 3351", "R": "020828 ~28484525 2505 2542", "S": "~4748080545420203", "T": "0848 2822",
    "U": "0804 ~04024244 4448", "V": "082248", "W": "0822476288", "X": "0842 0248", "Y": "082548 2522", "Z": "08480242",
    "0": "o02424808", "1": "062822", "2": "~0708484502 0242", "3": "~0708484525 ~2545420203", "4": "380444 3632",
    "5": "480805 ~0545420203", "6": "o02424505 ~040838", "7": "084812", "8": "o05454808 o02424505",
    "9": "o05454808 ~464212", " ": "", ".": "0202", ",": "1201", ":": "0202 0505", "-": "0535", "–": "0545",
    "+": "0545 2327", "°": "o06262808", "(": "~19070311", ")": "~09171301", "/": "0238", "_": "0242",
    "?": "~0708484525 2524 2222",
}  # fmt: skip
_SPACE, _GAP, _STROKE = 3, 2.2, 0.85  # in grid steps


def lettering(text: str, *, size: float) -> NDArray[np.float64]:
    """Draw one line of text.

    Parameters
    ----------
    text : letters without accents, digits and simple signs; any other character becomes a question mark
    size : height of a capital letter, in pixels

    Returns
    -------
    (height, width) coverage between 0 and 1; the baseline lies at 0.8 of the height
    """
    step = size / 6  # a capital is 6 grid steps high
    glyphs = [_segments(character if character in _GLYPHS else "?") for character in text]
    widths = [(glyph[..., 0].max() if len(glyph) else _SPACE - _GAP) + _GAP for glyph in glyphs]
    height, width = int(np.ceil(10 * step)), int(np.ceil((sum(widths) + 1) * step))
    coverage = np.zeros((height, width))
    left = _STROKE
    for glyph, advance in zip(glyphs, widths, strict=True):
        if len(glyph):
            first, last = int((left - 1) * step), int((left + advance) * step) + 1
            y, x = np.mgrid[:height, max(first, 0) : min(last, width)] + 0.5
            ends = np.stack([glyph[..., 0] + left, 10 - glyph[..., 1]], axis=-1) * step
            ink = 0.5 + _STROKE * step / 2 - _distance(x, y, ends)
            window = coverage[:, max(first, 0) : min(last, width)]
            np.maximum(window, np.clip(ink, 0, 1), out=window)
        left += advance
    return coverage


def _distance(x: NDArray[np.float64], y: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each pixel to the nearest of the segments."""
    a, along = ends[:, 0, :, None, None], (ends[:, 1] - ends[:, 0])[:, :, None, None]
    squared = np.maximum((along**2).sum(axis=1), 1e-12)
    t = np.clip(((x - a[:, 0]) * along[:, 0] + (y - a[:, 1]) * along[:, 1]) / squared, 0, 1)
    squares = (x - a[:, 0] - t * along[:, 0]) ** 2 + (y - a[:, 1] - t * along[:, 1]) ** 2
    return np.asarray(np.sqrt(squares.min(axis=0)))


@cache
def _segments(character: str) -> NDArray[np.float64]:
    """(k, 2, 2) ends of the straight pieces of a glyph, in grid steps."""
    pieces = []
    for path in _GLYPHS[character].split():
        digits = path.lstrip("~o")
        points = np.array([[int(x), int(y)] for x, y in zip(digits[::2], digits[1::2], strict=True)], float)
        if path[0] in "~o":
            points = _rounded(points, closed=path[0] == "o")
        pieces.append(np.stack([points[:-1], points[1:]], axis=1))
    return np.concatenate(pieces) if pieces else np.empty((0, 2, 2))


def _rounded(points: NDArray[np.float64], *, closed: bool) -> NDArray[np.float64]:
    """Cut the corners of a path three times (Chaikin 1974)."""
    if closed:
        points = np.concatenate([points, points[:1]])
    for _ in range(3):
        cut = np.stack([0.75 * points[:-1] + 0.25 * points[1:], 0.25 * points[:-1] + 0.75 * points[1:]], axis=1)
        ends = (cut.reshape(-1, 2)[:1], points[-1:]) if closed else (points[:1], points[-1:])
        points = cut.reshape(-1, 2)
        points = np.concatenate([points, ends[0]]) if closed else np.concatenate([ends[0], points, ends[1]])
    return points
