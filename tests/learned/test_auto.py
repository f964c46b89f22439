"""What `auto` removes and what it leaves, on shapes that no training saw."""

import numpy as np
import pytest
from shapes import ball_of_voxels, grid, mean_angle

import cascadenorm as cn
from cascadenorm.data_gen import DatasetConfig, pair
from cascadenorm.data_gen.scanning.isosurfaces import marching_tetrahedra
from cascadenorm.data_gen.scanning.volumes import volume_surface
from cascadenorm.learned.methods import mesh_treatment
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


@pytest.mark.parametrize("family", ["decimated", "low_poly", "subdivided", "structured", "cad_tessellation"])
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
