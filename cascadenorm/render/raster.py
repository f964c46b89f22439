"""Rasterize triangles with a depth buffer and supersampling, in bands of rows."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Floats, Index, Ints32, Vectors, kernel, parallel_for

SMALLEST_BAND = 16
LINE = 0.02  # linear grey level of wireframe lines
LINE_COVERAGE = 0.75


class Painted(NamedTuple):
    """Triangles on the screen with their colours."""

    # (n, 3) x to the right and y down in pixels from the upper left, z toward the viewer and linear on the screen
    points: NDArray[np.float64]
    faces: NDArray[np.int32]  # (m, 3) corners of the triangles
    palette: NDArray[np.float64]  # (k, 3) linear colours
    # (m, 1) of each triangle, or (m, 3) at its corners and interpolated between them
    places: NDArray[np.float64]  # palette row, rounded after the interpolation
    light: NDArray[np.float64]  # factor of the colour
    perspective: float = 0.0  # reciprocal of the distance of the viewer, in the unit of z
    line: float = 0.0  # width of the edges of the triangles in pixels; 0 draws none

    def without(self, faces: NDArray[np.bool_]) -> "Painted":
        """Return the triangles except those that are marked, (m,)."""
        kept = self.faces[~faces]
        kept.flags.writeable = False  # as those of meshes, for which the kernels are compiled
        return self._replace(faces=kept, places=self.places[~faces], light=self.light[~faces])


def rasterize(painted: Painted, *, width: int, height: int, samples: int) -> NDArray[np.float64]:
    """Rasterize triangles, with the nearest in front. Each pixel is the mean of samples × samples points.

    Returns (height, width, 4) linear colour times coverage, and coverage. Of two triangles at equal depth, the one with
    the smaller index is visible.
    """
    picture = np.zeros((height, width, 4))
    settings = (painted.perspective, painted.line * samples / 2, width, samples, picture)
    parallel_for(height, _paint_rows, *painted[:5], *settings, smallest=SMALLEST_BAND)
    return picture


@kernel
def _paint_rows(
    start: int,
    stop: int,
    points: Vectors,
    faces: Ints32,
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
    _find_nearest(start, points, faces, samples, seen)
    _shade(start, points, faces, palette, places, light, perspective, half_line, samples, seen, picture)
    picture[start:stop] /= samples * samples


@kernel
def _corners(
    start: int, points: Vectors, faces: Ints32, samples: int, f: Index
) -> tuple[float, float, float, float, float, float, float]:
    """Return the corners of a triangle in samples, relative to the row `start`, and twice its signed area."""
    ax, ay = points[faces[f, 0], 0] * samples, (points[faces[f, 0], 1] - start) * samples
    bx, by = points[faces[f, 1], 0] * samples, (points[faces[f, 1], 1] - start) * samples
    cx, cy = points[faces[f, 2], 0] * samples, (points[faces[f, 2], 1] - start) * samples
    return ax, ay, bx, by, cx, cy, (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@kernel
def _centers_between(low: float, high: float, count: int) -> tuple[int, int]:
    """Return the first and the last of `count` cells with their center between two coordinates."""
    first = max(0, int(np.ceil(max(-1.0, low - 0.5))))
    return first, min(count - 1, int(np.floor(min(count + 1.0, high - 0.5))))


@kernel
def _find_nearest(start: int, points: Vectors, faces: Ints32, samples: int, seen: Ints32) -> None:
    """Find the nearest triangle at each sample, located at the center of its cell, in the rows from `start` on."""
    rows, columns = seen.shape
    depth = np.full((rows, columns), -np.inf)
    for f in range(len(faces)):
        ax, ay, bx, by, cx, cy, double_area = _corners(start, points, faces, samples, f)

        # the cells with their center in the bounding box
        top, bottom = _centers_between(min(ay, by, cy), max(ay, by, cy), rows)
        if top > bottom or double_area == 0:
            continue
        left, right = _centers_between(min(ax, bx, cx), max(ax, bx, cx), columns)

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
                z = a * points[faces[f, 0], 2] + b * points[faces[f, 1], 2] + c * points[faces[f, 2], 2]
                if z > depth[i, j]:
                    depth[i, j] = z
                    seen[i, j] = f


@kernel
def _shade(
    start: int,
    points: Vectors,
    faces: Ints32,
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
            ax, ay, bx, by, cx, cy, double_area = _corners(start, points, faces, samples, f)
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
            a *= 1.0 + perspective * points[faces[f, 0], 2]
            b *= 1.0 + perspective * points[faces[f, 1], 2]
            c *= 1.0 + perspective * points[faces[f, 2], 2]
            whole = a + b + c
            a, b, c = a / whole, b / whole, c / whole

            # look up the colour of the interpolated value, and apply the interpolated light and the line of an edge
            place = min(max(int(np.rint(_between(places, f, a, b, c))), 0), len(palette) - 1)
            strength = _between(light, f, a, b, c)
            pixel = picture[start + i // samples, j // samples]
            for channel in range(3):
                pixel[channel] += (1.0 - cover) * strength * palette[place, channel] + cover * LINE
            pixel[3] += 1.0


@kernel
def _between(values: Floats, f: Index, a: float, b: float, c: float) -> float:
    """Return the value of a triangle, or interpolate those at its corners."""
    value: float = values[f, 0]
    if values.shape[1] > 1:
        value = a * values[f, 0] + b * values[f, 1] + c * values[f, 2]
    return value
