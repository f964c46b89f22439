"""Features up to a width are kept or removed, and wider ones go the other way."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import eigh
from shapes import cube, grid, icosphere, mean_angle, noisy

import cascadenorm as cn
from cascadenorm.api.apply import run_with_controls
from cascadenorm.controls.detail import high_pass_filter
from cascadenorm.data_gen.dataset import DatasetConfig, pair
from cascadenorm.data_gen.noise.noise import NoiseKind
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.mesh import Mesh, Vectors, angles_between
from cascadenorm.registry import Method
from cascadenorm.registry.controls import checked_controls

BALL = icosphere(4)
EDGE = BALL.mean_edge_length


def wave(degree: int, mesh: Mesh = BALL) -> np.ndarray:
    """The zonal harmonic of the unit sphere: -Δ has the value degree (degree + 1), half a wave is π over its root."""
    return np.polynomial.Legendre.basis(degree)(mesh.vertices[:, 2])


def width(degree: int) -> float:
    return float(np.pi / np.sqrt(degree * (degree + 1)))


def amplitude(values: np.ndarray, degree: int) -> float:
    return float(values @ wave(degree) / (wave(degree) @ wave(degree)))


def share(wide: float) -> float:
    """What is moved of a wave, by its half length in widths of the feature to keep."""
    t = (1 + np.sqrt(2)) / wide**2
    return (t / (1 + t)) ** 2


def moved(displacement: Vectors, mesh: Mesh = BALL, **controls) -> Vectors:
    """What the controls leave of a displacement that a method would give."""
    method = Method("stand-in", lambda seen: seen.vertices + displacement * seen.diagonal / mesh.diagonal, "", {})
    return run_with_controls(method, mesh, {}, checked_controls(controls)).vertices - mesh.vertices


@pytest.mark.parametrize("degree", [2, 5, 8])
@pytest.mark.parametrize("wide", [0.25, 0.5, 1, 2, 4])
def test_waves_go_by_their_width(degree, wide):
    out = high_pass_filter(width(degree) / wide, BALL)(wave(degree)[:, None] * (1.0, -2.0, 0.0))
    left = [amplitude(column, degree) for column in out.T]
    np.testing.assert_allclose(left, share(wide) * np.array([1, -2, 0]), rtol=0.06, atol=1e-12)


@pytest.mark.parametrize("mesh", [noisy(grid(6, 6), 0.2), noisy(icosphere(1), 0.2)], ids=["open", "closed"])
def test_eigenvectors_of_the_laplacian_are_scaled(mesh):
    laplacian = cotangent_laplacian(mesh)
    values, vectors = eigh(laplacian.stiffness.toarray(), np.diag(laplacian.mass))
    for feature in (0.1, 1.0, 10.0):
        finer = high_pass_filter(feature, mesh)
        for column in range(0, len(values), 7):
            wide = np.pi / np.sqrt(max(values[column], 1e-9)) / feature
            out = finer(np.repeat(vectors[:, [column]], 3, axis=1))
            np.testing.assert_allclose(out[:, 1], share(wide) * vectors[:, column], atol=1e-7)


def test_the_shares_are_those_that_are_documented():
    documented = {1: 0.5, 2: 0.14, 4: 0.02, 0.5: 0.82, 0.25: 0.95}
    for wide, percent in documented.items():
        assert share(wide) == pytest.approx(percent, abs=0.005)


def test_a_mesh_of_features_keeps_the_wide_ones_and_loses_its_noise():
    bumpy = BALL.moved(BALL.vertices * (1 + 0.1 * wave(4))[:, None])
    rough = noisy(bumpy, 0.1, seed=1)
    out = cn.denoise(rough, method="laplacian", iterations=20, keep_detail=0.25 * width(4)).vertices
    plain = cn.denoise(rough, method="laplacian", iterations=20).vertices
    heights = {"plain": plain, "kept": out}
    heights = {name: amplitude(np.linalg.norm(v, axis=1) - 1, 4) for name, v in heights.items()}
    assert heights["kept"] == pytest.approx(0.1, rel=0.02) and heights["plain"] < 0.09
    assert np.linalg.norm(out - bumpy.vertices) < 0.55 * np.linalg.norm(rough.vertices - bumpy.vertices)


def test_nothing_finer_than_nothing():
    rough = noisy(BALL, 0.1)
    assert cn.denoise(rough, method="laplacian", keep_detail=0).vertices.tobytes() == rough.vertices.tobytes()


def test_without_end_all_goes_but_what_parts_move_as_a_whole():
    parts = Mesh(np.concatenate([BALL.vertices, BALL.vertices + 3]), np.concatenate([BALL.faces, BALL.faces + 2562]))
    shift = np.repeat([[0.1, 0, 0], [0, 0.2, 0]], 2562, axis=0)
    noise = 0.01 * np.random.default_rng(0).normal(size=shift.shape)
    for endless in (np.inf, 1e300, "1e12 edges"):
        out = moved(shift + noise, parts, keep_detail=endless)
        means = np.repeat([noise[:2562].mean(axis=0), noise[2562:].mean(axis=0)], 2562, axis=0)
        np.testing.assert_allclose(out, noise - means, atol=2e-4)
    np.testing.assert_allclose(moved(shift + noise, parts), shift + noise, atol=1e-12)


def test_a_length_counts_edges_where_it_says_so_and_the_limit_comes_last():
    noise = 0.01 * np.random.default_rng(1).normal(size=BALL.vertices.shape)
    by_edges, by_length = (moved(noise, keep_detail=keep) for keep in ("4 edges", 4 * EDGE))
    np.testing.assert_allclose(by_edges, by_length, rtol=1e-12, atol=1e-15)
    assert np.linalg.norm(by_edges) > 0.8 * np.linalg.norm(noise)
    limited = moved(noise, keep_detail="4 edges", max_displacement=0.005)
    assert np.linalg.norm(limited, axis=1).max() <= 0.005


@pytest.mark.parametrize("mesh", [grid(20, 20), noisy(grid(20, 20), 0.3)], ids=["flat", "rough"])
def test_moving_an_open_mesh_as_a_whole_moves_nothing(mesh):
    out = high_pass_filter(3.0, mesh)(np.ones_like(mesh.vertices))
    np.testing.assert_allclose(out, 0, atol=1e-8)


def test_scale_does_not_matter():
    noise = 0.01 * np.random.default_rng(1).normal(size=BALL.vertices.shape)
    for scale in (1e-9, 1e7):
        out = moved(noise * scale, BALL.moved(BALL.vertices * scale), keep_detail=0.3 * scale)
        np.testing.assert_allclose(out / scale, moved(noise, keep_detail=0.3), atol=1e-9)


def test_wrong_lengths_are_refused_with_a_reason():
    for wrong in (-1, "wide", float("nan")):
        with pytest.raises(cn.ParameterError, match=r"keep_detail is .*; it must be a length, at least 0"):
            cn.denoise(BALL, method="laplacian", keep_detail=wrong)


def roughness(mesh: Mesh) -> float:
    """Mean angle between the normals of adjacent faces, in degrees."""
    first, second = mesh.topology.face_pairs.T
    return float(np.degrees(angles_between(mesh.face_normals[first], mesh.face_normals[second])).mean())


def bumps(mesh: Mesh, seed: int) -> Mesh:
    """An error that is alike over several edges, which no filter of single vertices sees."""
    heights = np.random.default_rng(seed).normal(size=(len(mesh.vertices), 1))
    for _ in range(12):
        heights = mesh.sums_around(mesh.areas[:, None] * heights[mesh.faces].mean(axis=1))
        heights /= heights.std()
    return mesh.moved(mesh.vertices + 0.4 * mesh.mean_edge_length * heights * mesh.vertex_normals)


BUMPY = bumps(icosphere(4), 0)


def test_strength_of_auto_removes_more_and_more_without_a_jump():
    strengths = (0.0, 0.5, 1.0, 1.0001, 1.5, 2.0, 3.0, 5.0)
    outs = [cn.denoise(BUMPY, strength=strength) for strength in strengths]
    left = [roughness(mesh) for mesh in outs]
    assert left[2] == pytest.approx(left[3], abs=0.01)
    assert all(after < 0.99 * before for before, after in pairwise(left[3:]))
    assert np.abs(outs[2].vertices - outs[3].vertices).max() < 1e-3 * BUMPY.mean_edge_length


KINDS: dict[str, tuple[str, NoiseKind]] = {
    "independent": ("bust", "normal"),
    "correlated": ("bust", "correlated"),
    "segmentation": ("segmentation", "none"),
    "slices": ("slices", "none"),
    "tomogram": ("tomogram", "none"),
    "points": ("points", "none"),
    "fused": ("fused", "sensor"),
    "depth image": ("view", "sensor"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_more_strength_of_auto_removes_more_of_every_kind_of_error(kind):
    family, noise = KINDS[kind]
    config = DatasetConfig(
        families=(family,), noise_kinds=(noise,), min_level=0.3, min_faces=1200, max_faces=1500, seed=5
    )
    mesh = pair(config, 0).noisy
    edge = mesh.mean_edge_length
    outs = [cn.denoise(mesh, strength=strength).vertices for strength in (0, 0.5, 1, 1.5, 2, 2.001, 3, 4)]
    removed = [np.sqrt(np.mean((out - mesh.vertices) ** 2)) / edge for out in outs]
    assert all(after > before for before, after in pairwise(removed[:5]))
    assert all(after > 0.99 * before for before, after in pairwise(removed[4:])) and removed[-1] > removed[4]
    assert np.abs(outs[5] - outs[4]).max() < 0.005 * edge


@pytest.mark.parametrize("method", ["auto", "bilateral-normal", "taubin"])
def test_detail_to_remove_goes_whatever_the_method_leaves(method):
    outs = [cn.denoise(BUMPY, method=method, remove_detail=width) for width in (None, 2 * EDGE, 5 * EDGE)]
    left = [mean_angle(out, BALL) for out in outs]
    assert left[1] < 0.97 * left[0] and left[2] < 0.97 * left[1]


def test_edges_of_a_cube_stay_under_strength_and_go_within_the_width_if_asked_for():
    part = cube(6)
    np.testing.assert_allclose(cn.denoise(part, strength=4).vertices, part.vertices, atol=1e-9)
    wide = 3 * part.mean_edge_length
    out = cn.denoise(part, method="taubin", iterations=0, remove_detail=wide)
    assert np.linalg.norm(out.vertices - part.vertices, axis=1).max() <= 0.5 * wide
