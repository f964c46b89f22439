"""Spectra of meshes tell shapes apart, whatever their pose and, if asked for, their size."""

import numpy as np
import pytest
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.geometry.spectra.harmonics import shape_dna
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh

MESH = noisy(icosphere(2), 0.2)


def test_eigenvalues_are_those_of_the_mesh(tmp_path):
    for scale in ("area", "keep"):
        found = cn.spectrum(MESH, count=20, scale=scale)
        np.testing.assert_allclose(found.values, shape_dna(MESH, 20, scale=scale), rtol=1e-9, atol=1e-9)
        assert found.other is None and found.distance is None
    save_mesh(tmp_path / "mesh.ply", MESH)
    np.testing.assert_array_equal(cn.spectrum(tmp_path / "mesh.ply").values, cn.spectrum(MESH).values)
    assert len(cn.spectrum(MESH).values) == 50


def test_the_distance_knows_shapes_and_by_area_no_sizes():
    larger, stretched = MESH.moved(3 * MESH.vertices), MESH.moved(MESH.vertices * (1, 1, 1.3))
    by_area, kept = cn.spectrum(MESH, larger, count=20), cn.spectrum(MESH, larger, count=20, scale="keep")
    assert by_area.distance == pytest.approx(0, abs=1e-6)
    assert kept.distance == pytest.approx(np.linalg.norm(kept.values) * (1 - 1 / 9), rel=1e-9)
    assert cn.spectrum(MESH, stretched, count=20).distance > 0.05 * np.linalg.norm(by_area.values)


@pytest.mark.parametrize("factor", [1e-120, 1e120])
def test_huge_and_tiny_meshes_with_degenerate_faces(factor):
    other = Mesh(factor * MESH.vertices, np.concatenate([MESH.faces, [(0, 0, 5)]]))
    np.testing.assert_allclose(cn.spectrum(other, count=9).values, cn.spectrum(MESH, count=9).values, atol=1e-7)
    kept = cn.spectrum(other, count=9, scale="keep").values[1:]
    np.testing.assert_allclose(kept * factor**2, cn.spectrum(MESH, count=9, scale="keep").values[1:], rtol=1e-7)


@pytest.mark.parametrize("repeated", [320, 90])
def test_faces_that_repeat_others_count_once(repeated):
    ball = noisy(icosphere(2), 0.1)
    other = Mesh(ball.vertices, [*ball.faces, *ball.faces[:repeated, ::-1]])
    assert cn.spectrum(ball, other, count=10).distance == pytest.approx(0, abs=1e-9)


def test_unknown_settings_are_refused():
    with pytest.raises(cn.ParameterError, match="scale is 'Area'; it must be keep or area"):
        cn.spectrum(icosphere(1), count=3, scale="Area")
    with pytest.raises(cn.ParameterError, match="boundary is 'Fixed'; it must be free or fixed"):
        cn.manifold_harmonics(icosphere(1), 3, boundary="Fixed")


def test_results_can_be_told_apart():
    one, other = (cn.spectrum(icosphere(1), count=3) for _ in range(2))
    assert one == one and one != other and len({one, other}) == 2
