"""Flat steps are found with the width that removes them, and nothing else is taken for them."""

import numpy as np
import pytest
from shapes import grid, icosphere

import cascadenorm as cn
from cascadenorm.detection.treads import treads
from cascadenorm.mesh import Mesh, angles_between


def slope(step: float) -> tuple[Mesh, Mesh]:
    """A curved slope of 80 by 80 squares with heights rounded to multiples of a step, and without."""
    flat = grid(80, 80)
    x, y = flat.vertices[:, 0], flat.vertices[:, 1]
    heights = flat.mean_edge_length * (0.25 * 80 * (x - x.min()) / np.ptp(x) + 4 * np.sin(3 * y / np.ptp(y)))
    rounded = step * flat.mean_edge_length * np.round(heights / (step * flat.mean_edge_length))
    first, second = (flat.moved(np.column_stack([x, y, z])) for z in (rounded, heights))
    return first, second


@pytest.mark.parametrize("step", [1.2, 1.6])
def test_steps_of_rounded_heights_go_with_the_width_that_was_found(step):
    rounded, smooth = slope(step)
    found = treads(rounded)
    assert found is not None and 12 <= found.count < 80

    def error(vertices):
        return np.degrees(angles_between(rounded.moved(vertices).face_normals, smooth.face_normals)).mean()

    denoised = cn.denoise(rounded.vertices, rounded.faces, remove_detail=f"{np.ceil(found.width):.0f} edges")
    assert error(denoised) < 0.4 * error(rounded.vertices)


def test_surfaces_without_steps_have_no_treads():
    assert treads(slope(1.5)[1]) is None
    assert treads(grid(30, 30)) is None
    assert treads(icosphere(3)) is None
    assert treads(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32))) is None
