"""Triangles on a screen to pixels: a depth buffer over bands of rows, each pixel the mean of its samples."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Floats, kernel, parallel_for

SMALLEST_BAND = 16


def rasterize(
    screen: NDArray[np.float64], colors: NDArray[np.float64], *, width: int, height: int, samples: int
) -> NDArray[np.float64]:
    """Paint triangles, the nearest one in front.

    Parameters
    ----------
    screen : (m, 3, 3) corners: x to the right and y downward in pixels from the upper left, z toward the viewer; z
        has to be linear parallel_for the screen
    colors : (m, 3) one linear colour a triangle
    samples : each pixel is the mean of samples × samples points

    Returns
    -------
    (height, width, 4) linear colour times coverage, and coverage; where two triangles are equally near the one
    with the smaller number is seen
    """
    picture = np.zeros((height, width, 4))
    parallel_for(
        height, _paint_rows, np.ascontiguousarray(screen), colors, width, samples, picture, smallest=SMALLEST_BAND
    )
    return picture


@kernel
def _paint_rows(
    start: int, stop: int, screen: Floats, colors: Floats, width: int, samples: int, picture: Floats
) -> None:
    rows, columns = (stop - start) * samples, width * samples
    depth = np.full((rows, columns), -np.inf)
    seen = np.full((rows, columns), -1, np.int32)
    for f in range(len(screen)):
        ax, ay = screen[f, 0, 0] * samples, (screen[f, 0, 1] - start) * samples
        bx, by = screen[f, 1, 0] * samples, (screen[f, 1, 1] - start) * samples
        cx, cy = screen[f, 2, 0] * samples, (screen[f, 2, 1] - start) * samples
        double_area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if double_area == 0:
            continue
        # points lie in the middle of their cells
        top = max(0, int(np.ceil(max(-1.0, min(ay, by, cy) - 0.5))))
        bottom = min(rows - 1, int(np.floor(min(rows + 1.0, max(ay, by, cy) - 0.5))))
        left = max(0, int(np.ceil(max(-1.0, min(ax, bx, cx) - 0.5))))
        right = min(columns - 1, int(np.floor(min(columns + 1.0, max(ax, bx, cx) - 0.5))))
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
    for i in range(rows):
        for j in range(columns):
            f = seen[i, j]
            if f >= 0:
                pixel = picture[start + i // samples, j // samples]
                for channel in range(3):
                    pixel[channel] += colors[f, channel]
                pixel[3] += 1.0
    picture[start:stop] /= samples * samples
