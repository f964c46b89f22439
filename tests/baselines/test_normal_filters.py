"""What holds for every filter of face normals."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, mean_angle, noisy

from cascadenorm.api.api import methods
from cascadenorm.mesh import Mesh

KEEP_EDGES = {  # parameters that tell the sides of a cube apart
    "bilateral-normal": {"sigma_r": 0.1},
    "bilateral-normal-global": {"sigma_r": 0.1},
    "guided-normal": {"sigma_r": 0.1},
    "median-normal": {},
    "random-walk-normal": {"sigma_r": 0.1},
    "static-dynamic-normal": {"sigma_r": 0.1},
    "tgv-normal": {"fidelity": 1e6},
    "tv-normal": {"fidelity": 1e6},
    "unilateral-normal": {},
}
FILTERS = {**KEEP_EDGES, "mean-normal": {}}
CUT_CORNERS = ("guided-normal", "median-normal")
"""A triangle that cuts a corner off has no flat patch to be guided by, and is outvoted by those across the edges."""
name = pytest.mark.parametrize("name", FILTERS)


def bent_sheet(steps: int) -> Mesh:
    """A square sheet with a right-angled bend in the middle."""
    sheet = grid(steps, steps)
    x, y, _ = sheet.vertices.T
    return sheet.moved(np.stack([np.minimum(x, steps // 2), y, np.maximum(x - steps // 2, 0)], axis=1))


@name
def test_a_plane_stays(name):
    np.testing.assert_allclose(methods()[name](grid(8, 8)), grid(8, 8).vertices, atol=1e-12)


@pytest.mark.compiled
@pytest.mark.parametrize("name", KEEP_EDGES)
def test_an_edge_and_a_noise_free_cube_stay(name):
    for mesh in (bent_sheet(8),) if name in CUT_CORNERS else (bent_sheet(8), cube(5)):
        out = methods()[name](mesh, **KEEP_EDGES[name])
        np.testing.assert_allclose(out, mesh.vertices, atol=1e-7 * mesh.mean_edge_length)


@pytest.mark.compiled
@name
def test_noise_goes(name):
    for clean in (icosphere(3),) if name == "mean-normal" else (cube(10), icosphere(3)):
        rough = noisy(clean, 0.12, seed=4)
        smooth = rough.moved(methods()[name](rough))
        assert mean_angle(smooth, clean) < 0.55 * mean_angle(rough, clean)


@name
def test_in_plane_noise_of_a_sheet_stays_in_its_plane(name):
    sheet = grid(8, 8)
    jitter = np.random.default_rng(0).uniform(-0.2, 0.2, sheet.vertices.shape) * (1, 1, 0)
    out = methods()[name](sheet.moved(sheet.vertices + jitter))
    np.testing.assert_allclose(out[:, 2], 0, atol=1e-12)


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("name", "spread"),
    [
        *(("bilateral-normal", spread) for spread in ("sigma_s", "sigma_r")),
        *(("bilateral-normal-global", spread) for spread in ("sigma_s", "sigma_r")),
        *(("guided-normal", spread) for spread in ("radius", "sigma_s", "sigma_r")),
        ("random-walk-normal", "sigma_r"),
        *(("static-dynamic-normal", spread) for spread in ("sigma_s", "sigma_g")),
    ],
)
def test_a_spread_whose_square_overflows_acts_as_infinity(name, spread):
    ball = noisy(icosphere(1), 0.1)
    vertices = [methods()[name](ball, **{spread: value}) for value in (1e200, np.inf)]
    np.testing.assert_array_equal(*vertices)
