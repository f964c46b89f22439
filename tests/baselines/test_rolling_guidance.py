"""Rolling guidance removes what is narrow, keeps what is wide, and keeps edges."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.baselines.rolling_guidance import rolled_normals
from cascadenorm.mesh import Mesh, angles_between

SHEET = grid(60, 60)


def waves(width: float, height: float = 0.05) -> Mesh:
    """A sheet with a sine along x whose half-wave is that many edges wide."""
    x = SHEET.vertices[:, 0]
    edge = np.ptp(x) / 60
    return SHEET.moved(SHEET.vertices + height * edge * np.sin(np.pi * x / (width * edge))[:, None] * (0, 0, 1))


def slope_left(mesh: Mesh, width: float) -> float:
    """Share of the slopes of the faces away from the boundary that a filter of that width leaves."""
    normals = rolled_normals(mesh, width=width * np.ptp(mesh.vertices[:, 0]) / 60, sigma=1e6, iterations=1)
    reach = np.abs(mesh.centroids - mesh.centroids.mean(axis=0)).max(axis=0)
    inner = (np.abs(mesh.centroids - mesh.centroids.mean(axis=0))[:, :2] < 0.6 * reach[:2]).all(axis=1)
    return float(
        (normals[inner, 0] @ mesh.face_normals[inner, 0]) / (mesh.face_normals[inner, 0] @ mesh.face_normals[inner, 0])
    )


@pytest.mark.parametrize(("ratio", "share"), [(1.0, 0.5), (2.0, 0.82), (4.0, 0.95), (0.5, 0.14)])
def test_shares_of_waves_are_those_of_two_implicit_steps(ratio, share):
    assert slope_left(waves(8), 8 / ratio) == pytest.approx(share, abs=0.03)


def test_wide_edges_stay_where_narrow_waves_go():
    rough = noisy(cube(16), 0.15)
    guided, even = (cn.denoise(rough, method="rolling-guidance-normal", width=3, sigma=sigma) for sigma in (0.6, 1e6))
    errors = [
        np.degrees(angles_between(mesh.face_normals, cube(16).face_normals)).mean() for mesh in (rough, guided, even)
    ]
    assert errors[1] < 0.25 * errors[0]
    assert errors[1] < 0.7 * errors[2]


def test_no_width_changes_nothing():
    rough = noisy(icosphere(2), 0.2)
    assert cn.denoise(rough, method="rolling-guidance-normal", width=0).vertices.tobytes() == rough.vertices.tobytes()


@pytest.mark.parametrize("width", [1e6, 1e300])
def test_a_width_beyond_the_mesh_is_like_one_as_large_as_the_mesh(width):
    rough = noisy(grid(10, 10), 0.2)
    wide, wider = (cn.denoise(rough, method="rolling-guidance-normal", width=w).vertices for w in (1e3, width))
    np.testing.assert_array_equal(wide, wider)
