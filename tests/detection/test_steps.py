"""Steps of enlarged volumes and of rounded heights are found with their width."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes import grid, icosphere
from skimage.measure import marching_cubes

import cascadenorm as cn
from cascadenorm.detection import steps
from cascadenorm.detection.steps import enlarged_steps, enlargement, treads
from cascadenorm.mesh import Mesh, angles_between


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


@pytest.mark.parametrize("binary", [True, False], ids=["mask", "grey"])
def test_some_of_many_vertices_tell_the_factor(binary, monkeypatch):
    mesh = ball(15, 4, binary=binary)
    monkeypatch.setattr(steps, "MOST_VERTICES", len(mesh.vertices) // 7)
    assert enlargement(mesh) == 4


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


def mirrored(mesh: Mesh, rows: float) -> Mesh:
    """The mesh together with its mirror image below, so far away that the two do not touch."""
    below = mesh.vertices * (1, 1, -1) - (0, 0, rows)
    return Mesh(np.concatenate([mesh.vertices, below]), np.concatenate([mesh.faces, mesh.faces[:, ::-1] + len(below)]))


def test_flat_steps_on_both_sides_of_a_part_are_its_shape():
    rounded, _ = slope(1.6)
    assert treads(rounded) is not None
    assert treads(mirrored(rounded, 100)) is None


def test_a_flat_base_does_not_hide_steps():
    rounded, _ = slope(1.6)
    flat = mirrored(rounded, 100)
    base = flat.vertices.copy()
    base[len(rounded.vertices) :, 2] = -100
    found, alone = treads(flat.moved(base)), treads(rounded)
    assert found is not None and alone is not None
    assert found.count == alone.count


def test_a_flat_base_is_no_step():
    flat = grid(87, 20)
    stairs = flat.moved(np.column_stack([flat.vertices[:, :2], 3.0 * (flat.vertices[:, 1] // 8)]))  # 11 treads
    with_base = mirrored(stairs, 100)
    vertices = with_base.vertices.copy()
    vertices[len(stairs.vertices) :, 2] = -100
    assert treads(stairs) is None
    assert treads(with_base.moved(vertices)) is None


def test_surfaces_without_steps_have_no_treads():
    assert treads(slope(1.5)[1]) is None
    assert treads(grid(30, 30)) is None
    assert treads(icosphere(3)) is None
    assert treads(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32))) is None
