import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skimage.measure import marching_cubes

from cascadenorm.detection.enlarged_steps import enlarged_steps, enlargement
from cascadenorm.mesh import Mesh


def ball(voxels: int, factors: int | tuple[int, int, int], *, binary: bool, seed: int = 0) -> Mesh:
    """An ellipsoid in a volume of so many voxels along each axis, each of them repeated."""
    places = np.stack(np.meshgrid(*[np.linspace(-1, 1, voxels)] * 3, indexing="ij"), axis=-1)
    shift = np.random.default_rng(seed).uniform(-0.05, 0.05, 3)
    values = 0.7 - np.linalg.norm((places - shift) * (1, 1.2, 0.9), axis=-1)
    values = np.where(values > 0, 1.0, -1.0) if binary else values
    for axis, factor in enumerate(np.broadcast_to(factors, 3)):
        values = np.repeat(values, factor, axis=axis)
    vertices, faces, *_ = marching_cubes(values, 0.0)
    return Mesh(vertices, faces)


@pytest.mark.parametrize("binary", [True, False], ids=["mask", "grey"])
@pytest.mark.parametrize("factor", [1, 2, 3, 5])
def test_the_factor_of_an_enlarged_volume_is_found(factor, binary):
    assert enlargement(ball(60 // factor, factor, binary=binary)) == (factor if factor > 1 else 0)


def test_a_mask_may_lie_at_any_angle_and_scale():
    mesh = ball(16, 3, binary=True)
    turned = 1e-3 * mesh.vertices @ Rotation.random(random_state=1).as_matrix() + 7
    assert enlargement(mesh.moved(turned)) == 3


def test_slices_that_are_repeated_along_one_axis_are_no_enlarged_volume():
    assert enlargement(ball(24, (1, 1, 3), binary=True)) == 0


def test_a_box_has_too_few_layers_to_tell():
    mask = np.full((30, 30, 30), -1.0)
    mask[6:24, 6:18, 6:24] = 1
    vertices, faces, *_ = marching_cubes(mask, 0.0)
    assert enlargement(Mesh(vertices, faces)) == 0


def test_each_component_has_the_width_of_its_own_steps():
    parts = [ball(48, 1, binary=True), ball(16, 3, binary=True), ball(12, 4, binary=False)]
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    mesh = Mesh(
        np.concatenate([part.vertices + 100 * k for k, part in enumerate(parts)]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts[:-1], strict=True)]),
    )
    expected = [0, 6 * parts[1].mean_edge_length, 8 * parts[2].mean_edge_length]
    np.testing.assert_allclose(enlarged_steps(mesh), expected, rtol=1e-9)
