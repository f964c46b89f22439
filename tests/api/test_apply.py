"""A method is applied as often as its strength says, within the limits, and to a mesh near unit size."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.apply import run_with_controls, step_key
from cascadenorm.errors import ParameterError
from cascadenorm.mesh import Mesh
from cascadenorm.registry import Method
from cascadenorm.registry.controls import checked_controls

BALL = noisy(icosphere(2), 0.2)
METHOD = {"method": "bilateral-normal"}


def shifted(mesh: Mesh) -> np.ndarray:
    """Stand-in for a method: every vertex goes one unit of the frame along x."""
    return mesh.vertices + np.array([1.0, 0.0, 0.0])


def apply(function, mesh=BALL, **controls):
    return run_with_controls(Method("stand-in", function, "", {}), mesh, {}, checked_controls(controls)).vertices


@given(st.floats(0, 4), st.floats(0, 1))
@settings(max_examples=30)
def test_strength_times_weight_counts_applications(strength, weight):
    out = apply(shifted, strength=strength, mask=np.full(len(BALL.vertices), weight))
    once = apply(shifted)[:, 0] - BALL.vertices[:, 0]
    np.testing.assert_allclose(out[:, 0] - BALL.vertices[:, 0], strength * weight * once, atol=1e-12)
    np.testing.assert_array_equal(out[:, 1:], BALL.vertices[:, 1:])


def test_no_method_is_applied_again_to_a_mesh_that_it_has_moved_to_one_place():
    def collapsed(mesh):
        assert mesh.mean_edge_length > 0
        return np.zeros_like(mesh.vertices)

    np.testing.assert_array_equal(apply(collapsed, strength=3), apply(collapsed))


@pytest.mark.parametrize("converges", [False, True])
def test_another_strength_of_the_same_key_blends_what_is_known_and_gives_the_same_bytes(converges):
    calls = []

    def halved(mesh):
        calls.append(mesh)
        return 0.5 * mesh.vertices

    method = Method("stand-in", halved, "", {}, converges)
    steps = {}
    for strength in (1.0, 0.3, 0.8, 2.5, 2.0, 1.5):
        controls = checked_controls({"strength": strength})
        known = steps.setdefault(step_key(method, strength), [])
        made = len(calls) + max(0, int(np.ceil(min(strength, 1.0) if converges else strength)) - len(known))
        out = run_with_controls(method, BALL, {}, controls, steps=known).vertices
        assert len(calls) == made
        assert out.tobytes() == run_with_controls(method, BALL, {}, controls).vertices.tobytes()
        del calls[made:]
    assert len(steps) == (4 if converges else 1)


def test_progress_goes_from_nothing_to_all_and_can_end_the_work():
    shares = []
    apply(shifted, strength=3, progress=shares.append)
    assert shares == [0, 1 / 3, 2 / 3, 1]

    def stop(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        apply(shifted, progress=stop)


def test_limit_counts_mean_edge_lengths_where_it_says_so():
    limit = 0.25 * BALL.mean_edge_length
    by_edges = apply(shifted, max_displacement="0.25 edges")
    np.testing.assert_array_equal(by_edges, apply(shifted, max_displacement=limit))
    np.testing.assert_allclose(by_edges[:, 0] - BALL.vertices[:, 0], limit, rtol=1e-12)


def test_vertices_that_are_not_finite_are_an_error_and_not_a_result():
    with pytest.raises(cn.DenoiseError, match=r"1 vertices that are not finite \(vertices 3\)"):
        apply(lambda mesh: np.where(np.arange(len(mesh.vertices))[:, None] == 3, np.nan, mesh.vertices))


def test_a_region_is_given_by_the_mask():
    with pytest.raises(ParameterError, match="pass mask"):
        cn.denoise(BALL, method="laplacian", region=None)
    half = BALL.vertices[:, 2] > 0
    out = cn.denoise(BALL, method="laplacian", iterations=50, mask=half).vertices
    held = cn.methods()["laplacian"].function(BALL, iterations=50, region=half)
    np.testing.assert_allclose(out, held, atol=1e-9)


def test_limit_comes_after_the_volume():
    out = cn.denoise(BALL, method="laplacian", volume="keep", max_displacement=1e-3).vertices
    assert np.linalg.norm(out - BALL.vertices, axis=1).max() <= 1e-3


@pytest.mark.parametrize("turned", [False, True])
def test_faces_that_are_there_twice_count_once(turned):
    mesh = noisy(icosphere(3), 0.1)
    again = mesh.faces[:, ::-1] if turned else mesh.faces
    doubled = cn.denoise(mesh.vertices, np.concatenate([mesh.faces, again]))
    np.testing.assert_allclose(doubled, cn.denoise(mesh.vertices, mesh.faces), atol=1e-12)
