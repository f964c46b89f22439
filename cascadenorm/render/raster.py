"""Rasterize triangles with a depth buffer and supersampling, in bands of rows."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Floats, Index, Ints32, kernel, parallel_for

SMALLEST_BAND = 16
LINE = 0.02
"""Linear grey level of wireframe lines."""
LINE_COVERAGE = 0.75


class Painted(NamedTuple):
    """Triangles on the screen with their colours."""

    # (m, 3, 3) corners: x to the right and y down in pixels from the upper left, z toward the viewer; z must be
    # linear on the screen
    screen: NDArray[np.float64]
    palette: NDArray[np.float64]  # (k, 3) linear colours
    places: NDArray[np.float64]  # (m, 3) palette row at each corner; interpolated between the corners and then rounded
    light: NDArray[np.float64]  # (m, 3) factor of the colour at each corner; interpolated as well
    perspective: float = 0.0  # reciprocal of the distance of the viewer, in the unit of z
    line: float = 0.0  # width of the edges of the triangles in pixels; 0 draws none


def rasterize(painted: Painted, *, width: int, height: int, samples: int) -> NDArray[np.float64]:
    """Rasterize triangles, with the nearest in front. Each pixel is the mean of samples × samples points.

    Returns (height, width, 4) linear colour times coverage, and coverage. Of two triangles at equal depth, the one with
    the smaller index is visible.
    """
    picture = np.zeros((height, width, 4))
    arrays = [np.ascontiguousarray(array, np.float64) for array in painted[:4]]
    settings = (painted.perspective, painted.line * samples / 2, width, samples, picture)
    parallel_for(height, _paint_rows, *arrays, *settings, smallest=SMALLEST_BAND)
    return picture


@kernel
def _paint_rows(
    start: int,
    stop: int,
    screen: Floats,
    palette: Floats,
    places: Floats,
    light: Floats,
    perspective: float,
    half_line: float,
    width: int,
    samples: int,
    picture: Floats,
) -> None:
    seen = np.full(((stop - start) * samples, width * samples), -1, np.int32)
    _find_nearest(start, screen, samples, seen)
    _shade(start, screen, palette, places, light, perspective, half_line, samples, seen, picture)
    picture[start:stop] /= samples * samples


@kernel
def _corners(
    start: int, screen: Floats, samples: int, f: Index
) -> tuple[float, float, float, float, float, float, float]:
    """Return the corners of a triangle in samples, relative to the row `start`, and twice its signed area."""
    ax, ay = screen[f, 0, 0] * samples, (screen[f, 0, 1] - start) * samples
    bx, by = screen[f, 1, 0] * samples, (screen[f, 1, 1] - start) * samples
    cx, cy = screen[f, 2, 0] * samples, (screen[f, 2, 1] - start) * samples
    return ax, ay, bx, by, cx, cy, (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@kernel
def _find_nearest(start: int, screen: Floats, samples: int, seen: Ints32) -> None:
    """Find the nearest triangle at each sample, located at the center of its cell, in the rows from `start` on."""
    rows, columns = seen.shape
    depth = np.full((rows, columns), -np.inf)
    for f in range(len(screen)):
        ax, ay, bx, by, cx, cy, double_area = _corners(start, screen, samples, f)
        if double_area == 0:
            continue

        # the cells with their center in the bounding box
        top = max(0, int(np.ceil(max(-1.0, min(ay, by, cy) - 0.5))))
        bottom = min(rows - 1, int(np.floor(min(rows + 1.0, max(ay, by, cy) - 0.5))))
        left = max(0, int(np.ceil(max(-1.0, min(ax, bx, cx) - 0.5))))
        right = min(columns - 1, int(np.floor(min(columns + 1.0, max(ax, bx, cx) - 0.5))))

        # keep the triangle where the center lies inside it, by barycentric coordinates, and nothing nearer was found
        for i in range(top, bottom + 1):
            y = i + 0.5
            for j in range(left, right + 1):
                x = j + 0.5
                a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / double_area
                b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / double_area
                c = 1.0 - a - b
                if a < 0 or b < 0 or c < 0:
                    continue
                z = a * screen[f, 0, 2] + b * screen[f, 1, 2] + c * screen[f, 2, 2]
                if z > depth[i, j]:
                    depth[i, j] = z
                    seen[i, j] = f


@kernel
def _shade(
    start: int,
    screen: Floats,
    palette: Floats,
    places: Floats,
    light: Floats,
    perspective: float,
    half_line: float,
    samples: int,
    seen: Ints32,
    picture: Floats,
) -> None:
    """Add the colour of each sample to its pixel, and 1 to its coverage."""
    rows, columns = seen.shape
    for i in range(rows):
        y = i + 0.5
        for j in range(columns):
            f = seen[i, j]
            if f < 0:
                continue

            # barycentric coordinates on the screen
            x = j + 0.5
            ax, ay, bx, by, cx, cy, double_area = _corners(start, screen, samples, f)
            a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / double_area
            b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / double_area
            c = 1.0 - a - b

            # distances to the edges on the screen
            cover = 0.0
            if half_line > 0:
                nearest = abs(a * double_area) / np.hypot(cx - bx, cy - by)
                nearest = min(nearest, abs(b * double_area) / np.hypot(ax - cx, ay - cy))
                nearest = min(nearest, abs(c * double_area) / np.hypot(bx - ax, by - ay))
                if nearest < half_line:
                    cover = LINE_COVERAGE

            # perspective-correct barycentric coordinates
            a *= 1.0 + perspective * screen[f, 0, 2]
            b *= 1.0 + perspective * screen[f, 1, 2]
            c *= 1.0 + perspective * screen[f, 2, 2]
            whole = a + b + c
            a, b, c = a / whole, b / whole, c / whole

            # look up the colour of the interpolated value, and apply the interpolated light and the line of an edge
            place = int(np.rint(a * places[f, 0] + b * places[f, 1] + c * places[f, 2]))
            place = min(max(place, 0), len(palette) - 1)
            strength = a * light[f, 0] + b * light[f, 1] + c * light[f, 2]
            pixel = picture[start + i // samples, j // samples]
            for channel in range(3):
                pixel[channel] += (1.0 - cover) * strength * palette[place, channel] + cover * LINE
            pixel[3] += 1.0
