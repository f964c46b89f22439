"""Surfaces of Blender are read as arrays, and positions written with all else kept."""

import numpy as np
import pytest
from blender_objects import BALL, RIGHT, SINGLE, active, denoise, denoised, positions

import cascadenorm as cn

bpy = pytest.importorskip("bpy", reason="bpy, Blender as a module, is not installed")

from cascadenorm.frontends.blender import surfaces  # noqa: E402 - imports bpy


def test_all_else_in_the_mesh_is_kept(ball):
    mesh = ball.data
    mesh.uv_layers.new(name="map").data.foreach_set("uv", np.linspace(0, 1, 2 * len(mesh.loops)))
    mesh.color_attributes.new("paint", "BYTE_COLOR", "CORNER").data[7].color = (1, 0.5, 0, 1)
    mesh.attributes.new("heat", "FLOAT", "POINT").data[3].value = 37.5
    mesh.normals_split_custom_set_from_vertices([(0.6, 0, 0.8)] * len(mesh.vertices))
    mesh.edges[5].use_seam = True
    before = {layer.name: bytes_of(layer) for layer in mesh.attributes if layer.name != "position"}
    denoise()
    assert {layer.name: bytes_of(layer) for layer in mesh.attributes if layer.name != "position"} == before
    assert {"map", "paint", "heat", "uv_seam"} <= {name.lstrip(".") for name in before} | {"uv_seam"}
    assert mesh.edges[5].use_seam and mesh.has_custom_normals


def bytes_of(layer):
    values = [
        next(getattr(item, n) for n in ("value", "vector", "color", "uv") if hasattr(item, n)) for item in layer.data
    ]
    return np.array([tuple(v) if hasattr(v, "__len__") else v for v in values]).tobytes()


def test_normals_stored_as_vectors_are_made_anew(ball):
    layer = ball.data.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT")
    if not ball.data.has_custom_normals:
        pytest.skip("this Blender, before 5.0, has no normals that are vectors")
    layer.data.foreach_set("vector", BALL.vertex_normals.astype(np.float32).ravel())
    denoise()
    stored = np.empty(3 * len(SINGLE), np.float32)
    ball.data.attributes["custom_normal"].data.foreach_get("vector", stored)
    new = cn.Mesh(positions(ball.data.vertices), BALL.faces)
    assert (np.einsum("ij,ij->i", stored.reshape(-1, 3), new.vertex_normals) > 0.99).all()
    assert np.abs(stored.reshape(-1, 3) - BALL.vertex_normals).max() > 0.05


def test_a_vertex_group_is_the_mask(ball):
    group = ball.vertex_groups.new(name="right")
    group.add(np.flatnonzero(RIGHT).tolist(), 0.5, "REPLACE")
    denoise(vertex_group="right")
    assert positions(ball.data.vertices).tobytes() == denoised(mask=RIGHT * 0.5).tobytes()
    assert positions(ball.data.vertices)[~RIGHT].tobytes() == SINGLE[~RIGHT].tobytes()
    ball.data.vertices.foreach_set("co", SINGLE.ravel())
    denoise(vertex_group="right", invert_vertex_group=True)
    assert positions(ball.data.vertices).tobytes() == denoised(mask=1 - RIGHT * 0.5).tobytes()
    with pytest.raises(RuntimeError, match="Mask is 'left', which is not a vertex group of ball"):
        denoise(vertex_group="left")


@pytest.mark.parametrize("mark", ["SHARP", "SEAM", "ANGLE"])
def test_marked_edges_or_an_angle_are_creases(ball, mark):
    edges = np.array([edge.vertices[:] for edge in ball.data.edges])
    chosen = (SINGLE[edges, 2] > 0).sum(axis=1) == 1
    for i in np.flatnonzero(chosen):
        setattr(ball.data.edges[i], "use_seam" if mark == "SEAM" else "use_edge_sharp", True)
    expected = denoised(creases=25.0 if mark == "ANGLE" else edges[chosen])
    denoise(creases=mark, crease_angle=np.radians(25))
    assert positions(ball.data.vertices).tobytes() == expected.tobytes() != denoised().tobytes()


def test_polygons_are_cut_and_the_scale_of_the_object_counts(ball):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=12, y_subdivisions=12)
    grid = active()
    grid.data.vertices.foreach_set("co", noisy_grid(positions(grid.data.vertices)).ravel())
    before, quads = positions(grid.data.vertices), len(grid.data.polygons)
    grid.scale = (2, 2, 5)
    bpy.context.view_layer.update()
    denoise(max_displacement="0.01")
    moved = np.linalg.norm((positions(grid.data.vertices) - before) * (2, 2, 5), axis=1)
    assert 0.0099 < moved.max() < 0.01001 and len(grid.data.polygons) == quads == 144


def noisy_grid(points):
    return points + np.random.default_rng(0).normal(size=points.shape).astype(np.float32) * (0, 0, 0.05)


def test_the_result_as_a_shape_key_keeps_the_mesh(ball):
    for strength in (1.0, 0.5):  # the second run begins from the mesh again
        denoise(result="SHAPE_KEY", strength=strength)
        keys = ball.data.shape_keys.key_blocks
        assert [key.name for key in keys] == ["Basis", surfaces.RESULT] and keys[surfaces.RESULT].value == 1
        assert positions(keys["Basis"].data).tobytes() == SINGLE.tobytes()
        assert positions(keys[surfaces.RESULT].data).tobytes() == denoised(strength=strength).tobytes()


def test_keys_that_are_relative_to_the_denoised_one_move_along(ball):
    ball.shape_key_add(name="Basis")
    open_mouth = ball.shape_key_add(name="open")
    open_mouth.data.foreach_set("co", (SINGLE + np.array([0, 0, 1])).astype(np.float32).ravel())
    ball.active_shape_key_index = 0
    denoise()
    np.testing.assert_allclose(positions(open_mouth.data), denoised() + np.array([0, 0, 1]), atol=1e-6)
    assert positions(ball.data.vertices).tobytes() == denoised().tobytes()
