"""What `auto` removes and what it leaves, on shapes that no training saw, and what it says that a mesh is."""

import numpy as np
import pytest
from shapes import ball_of_voxels, grid, icosphere, mean_angle, noisy
from terraces import MASK

import cascadenorm as cn
from cascadenorm.data_gen import DatasetConfig, pair
from cascadenorm.data_gen.scanning.isosurfaces import marching_tetrahedra
from cascadenorm.data_gen.scanning.volumes import volume_surface
from cascadenorm.io.interop import save_mesh
from cascadenorm.learned.methods import mesh_treatment, without_drift
from cascadenorm.mesh import Mesh, angles_between, unit


def nodes(count: int) -> np.ndarray:
    return np.stack(np.meshgrid(*[np.arange(count) - 0.5 * (count - 1) + 0.13] * 3, indexing="ij"), axis=-1)


def angle_to_ball(mesh: Mesh, middle: float) -> float:
    """Mean angle between the face normals and the directions from the middle of a ball, in degrees."""
    return float(np.degrees(angles_between(mesh.face_normals, unit(mesh.centroids - middle)).mean()))


def test_a_noisy_field_meshed_by_marching_tetrahedra_is_denoised():
    count, noise = 40, np.random.default_rng(0).normal(scale=0.2, size=(40, 40, 40))
    mesh = marching_tetrahedra(0.5 + 12 - np.linalg.norm(nodes(count), axis=-1) + noise)
    middle = 0.5 * (count - 1) - 0.13
    assert mesh_treatment(mesh).treatment == "measured-surface"
    assert angle_to_ball(mesh, middle) > 15
    assert angle_to_ball(cn.denoise(mesh), middle) < 0.2 * angle_to_ball(mesh, middle)


@pytest.mark.parametrize("radius", [3.5, 8.0])
def test_a_small_segmented_object_is_denoised_alone_in_its_file(radius):
    mesh = volume_surface(ball_of_voxels(radius).astype(float))
    assert angle_to_ball(cn.denoise(mesh), 14.7) < 0.3 * angle_to_ball(mesh, 14.7)


def test_a_grey_and_a_binary_surface_in_one_mesh_are_both_denoised():
    distance = np.linalg.norm(nodes(44), axis=-1)
    rough = 0.5 + 18 - distance + np.random.default_rng(0).normal(scale=0.15, size=distance.shape)
    grey, mask = volume_surface(rough), volume_surface((distance < 12).astype(float))
    both = Mesh(
        np.concatenate([grey.vertices, mask.vertices]), np.concatenate([grey.faces, mask.faces + len(grey.vertices)])
    )
    denoised = cn.denoise(both)
    for part, start, stop in ((grey, 0, len(grey.faces)), (mask, len(grey.faces), len(both.faces))):
        after = Mesh(denoised.vertices, denoised.faces[start:stop])
        assert angle_to_ball(after, 21.5 - 0.13) < 0.4 * angle_to_ball(part, 21.5 - 0.13)


@pytest.mark.parametrize("radius", [24.0, 27.5])
def test_a_clean_level_of_a_volume_stays(radius):
    ball = volume_surface(0.5 + radius - np.linalg.norm(nodes(60), axis=-1))
    assert mesh_treatment(ball).treatment == "measured-surface"
    assert mean_angle(cn.denoise(ball), ball) < 0.1


@pytest.mark.parametrize(
    "family",
    [
        "decimated",
        pytest.param("low_poly", marks=pytest.mark.slow),  # 5 s; other families are quicker
        "subdivided",
        "structured",
        "cad_tessellation",
    ],
)
def test_clean_meshes_of_programs_stay(family):
    config = DatasetConfig(
        seed=1_000_007, families=(family,), min_faces=3000, max_faces=5000, noise_kinds=("none",), relief=0.0
    )
    changes = []
    for index in range(4):
        clean = pair(config, index).clean
        changes.append(mean_angle(cn.denoise(clean), clean))
    assert np.median(changes) < 1.0
    assert max(changes) < 4.0


@pytest.mark.parametrize("rounding", [0.0, 0.02])
def test_terrain_a_few_posts_wide_is_shape(rounding):
    plain = grid(60, 60)
    x, y, _ = plain.vertices.T
    heights = 0.4 * (np.sin(0.9 * x + 0.4 * y) + np.sin(1.1 * y - 0.5 * x) + np.sin(0.7 * (x + y)))
    heights = np.round(heights / rounding) * rounding if rounding else heights
    terrain = plain.moved(np.stack([x, y, heights], axis=1))
    assert mean_angle(cn.denoise(terrain), terrain) < 0.3


BALL = icosphere(5)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_slow_waves_are_taken_back(degree):
    """The lowest spherical harmonics, over sixty edges and more."""
    wave = 0.01 * [np.ones(len(BALL.vertices)), BALL.vertices[:, 2], 3 * BALL.vertices[:, 2] ** 2 - 1][degree]
    found = without_drift(BALL, BALL.vertices * (1 + wave)[:, None])
    left = np.linalg.norm(found, axis=1) - 1
    assert rms(left) < 0.15 * rms(wave)


def test_noise_that_was_taken_away_stays_away():
    noise = 0.02 * np.random.default_rng(0).normal(size=len(BALL.vertices))
    noisy = BALL.moved(BALL.vertices * (1 + noise)[:, None])
    found = without_drift(noisy, BALL.vertices)
    assert rms(np.linalg.norm(found, axis=1) - 1) < 0.1 * rms(noise)


def test_nothing_happens_to_what_has_not_moved():
    assert without_drift(BALL, BALL.vertices).tobytes() == BALL.vertices.tobytes()


def test_vertices_that_have_not_moved_stay_where_the_rest_of_a_component_drifts():
    low = BALL.vertices[:, 2] < 0
    found = without_drift(BALL, np.where(low[:, None], BALL.vertices, 1.01 * BALL.vertices))
    assert found[low].tobytes() == BALL.vertices[low].tobytes()
    left = np.linalg.norm(found[BALL.vertices[:, 2] > 0.5], axis=1) - 1
    assert rms(left) < 0.15 * 0.01


def test_it_turns_and_scales_with_the_mesh():
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = BALL.vertices + 0.05 * rng.normal(size=BALL.vertices.shape)
    there = without_drift(BALL.moved(3 * BALL.vertices @ turn.T), 3 * moved @ turn.T)
    np.testing.assert_allclose(there, 3 * without_drift(BALL, moved) @ turn.T, atol=1e-12)


@pytest.mark.parametrize(
    ("settings", "treatment"),
    [
        ({}, "enlarged volume (probability 1.00)"),
        ({"remove_detail": 0}, "measured surface (probability 0.95)"),
        ({"remove_detail": "6 edges"}, "unknown"),
        ({"parameters": {"treat_as": "vertex-noise"}}, "vertex noise (as set)"),
    ],
)
def test_an_enlarged_mask_is_said_to_be_one_if_its_steps_are_removed(tmp_path, settings, treatment):
    save_mesh(tmp_path / "mask.ply", MASK)
    done = cn.denoise_file(tmp_path / "mask.ply", tmp_path / "out.ply", **settings)
    assert str(done.treated_as) == treatment
    assert done.treated_as == cn.inspect(MASK).treated_as or settings


def test_most_faces_decide_whether_a_mesh_is_said_to_be_enlarged():
    for balls, treatment in (2, "enlarged volume (probability 1.00, "), (3, "vertex noise (probability "):
        meshes = [MASK, *[noisy(icosphere(4), 0.15)] * balls]
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        vertices = np.concatenate([mesh.vertices + 5 * number for number, mesh in enumerate(meshes)])
        faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
        told = mesh_treatment(Mesh(vertices, faces))
        assert str(told).startswith(treatment)
        share = len(MASK.faces) / len(faces)
        assert told.share == pytest.approx(share if balls == 2 else 1 - share)


@pytest.mark.parametrize(("small", "treatment"), [(2, "vertex-noise"), (5, "unknown")])
def test_most_faces_decide_whether_a_mesh_is_said_to_be_unknown_because_of_copies(tmp_path, small, treatment):
    fine, coarse = noisy(icosphere(small), 0.2), noisy(icosphere(4), 0.2)
    vertices = np.concatenate([fine.vertices, coarse.vertices * 50 + 200])
    save_mesh(tmp_path / "two.ply", Mesh(vertices, np.concatenate([fine.faces, coarse.faces + len(fine.vertices)])))
    width = 4 * fine.mean_edge_length
    done = cn.denoise_file(tmp_path / "two.ply", tmp_path / "out.ply", remove_detail=width)
    assert (done.treated_as.treatment, done.treated_as.given) == (treatment, treatment == "unknown")
    assert done.treated_as.share == pytest.approx(max(len(fine.faces), len(coarse.faces)) / (20 * 4**small + 20 * 4**4))
