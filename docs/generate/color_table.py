"""Write the table of colours that pictures and the viewer share: python docs/generate/color_table.py [FILE]

Heat maps follow lines in OKLab (Ottosson 2020) on which lightness changes in even steps, so that equal differences of a
value look alike, with colour blindness and in grey as well.
"""

import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cascadenorm.render.color import COLOR_STEPS, encoded

TABLE = Path(__file__).parents[2] / "cascadenorm" / "render" / "colors.json"
SURFACES = {"clay": "b8c2d1", "inside": "cc8c6b", "unknown": "9e9e9e", "pinned": "f0641e"}
"""The surface without colours, its inside, faces without a value, and vertices that a user keeps in place."""
ZERO, LARGEST = 0.965, 0.30
"""Lightness at the ends of the map of unsigned values."""
STOPS, HUES, CHROMAS = (0.0, 0.25, 0.55, 0.8, 1.0), (110, 150, 212, 255, 275), (0.055, 0.1, 0.1, 0.12, 0.12)
"""Hue in degrees and chroma at some places of that map, from ivory over green to dark blue."""
TO_CONES = np.array(
    [(1, 0.3963377774, 0.2158037573), (1, -0.1055613458, -0.0638541728), (1, -0.0894841775, -1.291485548)]
)
TO_LIGHT = np.array(
    [
        (4.0767416621, -3.3077115913, 0.2309699292),
        (-1.2684380046, 2.6097574011, -0.3413193965),
        (-0.0041960863, -0.7034186147, 1.707614701),
    ]
)


def main() -> None:
    """Write the table."""
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else TABLE
    place = np.linspace(0, 1, COLOR_STEPS)
    away = np.abs(2 * place - 1)
    maps = {
        "sequential": oklab(
            ZERO + (LARGEST - ZERO) * place, np.interp(place, STOPS, CHROMAS), np.interp(place, STOPS, HUES)
        ),
        "diverging": oklab(0.93 - 0.45 * away, 0.14 * away, np.where(place < 0.5, 250, 55)),
    }
    table = SURFACES | {name: colors.tobytes().hex() for name, colors in maps.items()}
    file.write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8", newline="\n")


def oklab(lightness: NDArray[np.float64], chroma: NDArray[np.float64], hue: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return sRGB bytes, (k, 3), of colours in OKLab with hues in degrees."""
    angle = np.radians(hue)
    lab = np.stack([lightness, chroma * np.cos(angle), chroma * np.sin(angle)], axis=1)
    return encoded((lab @ TO_CONES.T) ** 3 @ TO_LIGHT.T)


if __name__ == "__main__":
    main()
