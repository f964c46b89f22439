"""A USD scene becomes one mesh as it is shown, and a mesh becomes a scene with its values."""

import numpy as np
import pytest
from sample_files import PLY_TEXT, read
from usd_layers import SCENE, with_attributes

import cascadenorm as cn
from cascadenorm import io

pytest.importorskip("pxr")

AGAIN = "double3 xformOp:translate = (0, 5, 0)"


def test_other_formats_get_the_scene_as_it_is_shown(tmp_path):
    file = read(SCENE.encode(), "usda")
    content = file.content()
    np.testing.assert_allclose(content.positions[:6], file.positions + np.array((10, 0, 0)))
    np.testing.assert_allclose(content.positions[6:], file.positions + np.array((10, 5, 0)))
    assert content.left_out == ("materials", "the up axis", "the unit", "normals", "the primvar 'st'")
    assert set(content.vertex_values) == set()  # vertex 1 has two texture coordinates
    one_each = SCENE.replace("(0, 0), (1, 0), (1, 1), (0, 1)]", "(1, 0), (2, 0), (2, 1), (1, 1)]")
    found = read(one_each.encode(), "usda").content().vertex_values
    assert found["s"].tolist() == [0, 1, 2, 0, 1, 2] * 2 and found["t"].tolist() == [0, 0, 0, 1, 1, 1] * 2


@pytest.mark.parametrize("format", ["usd", "usda", "usdc", "usdz"])
def test_conversion_keeps_values(format, tmp_path):
    file = read(PLY_TEXT)
    io.write(file, tmp_path / f"a.{format}")
    before, after = file.content(), cn.read(tmp_path / f"a.{format}").content()
    assert np.array_equal(after.positions, before.positions.astype(np.float32))
    assert np.array_equal(after.polygons.corners, before.polygons.corners)
    for found, expected in ((after.vertex_values, before.vertex_values), (after.face_values, before.face_values)):
        assert found.keys() == {name for name in expected if name != "alpha"}
        for name in found:
            assert np.array_equal(found[name], expected[name])


@pytest.mark.parametrize("hides", ['token visibility = "invisible"', 'uniform token purpose = "guide"'])
def test_meshes_that_the_scene_does_not_show_are_left_out(hides):
    for at, count in ((AGAIN, 6), ("double3 xformOp:translate = (10, 0, 0)", 12)):  # one, or all
        content = read(SCENE.replace(at, f"{at}\n{hides}").encode(), "usda").content()
        assert len(content.positions) == count
        assert ("meshes that the scene does not show" in content.left_out) == (count == 6)


def test_faces_that_are_holes_are_left_out_of_conversions():
    file = read(with_attributes("int[] holeIndices = [0]"), "usda")
    assert len(file.polygons) == 2 and file.content().polygons.corners.tolist() == [1, 2, 5, 4, 7, 8, 11, 10]


def test_proxies_are_shown_without_what_they_stand_for():
    proxy = SCENE.replace(AGAIN, AGAIN + '\nuniform token purpose = "proxy"')
    assert len(read(proxy.encode(), "usda").content().positions) == 12
    both = proxy.replace("float3[] extent", 'uniform token purpose = "render"\nfloat3[] extent')
    assert len(read(both.encode(), "usda").content().positions) == 6


def test_values_that_a_conversion_cannot_hold_are_named():
    speed = 'float3[] primvars:speed = [(0, 0, 1)] (interpolation = "constant")'
    left_out = read(with_attributes(speed), "usda").content().left_out
    assert left_out[-3:] == ("normals", "the primvar 'speed'", "the primvar 'st'")  # vertex 1 has two of st


def test_scenes_that_copy_themselves_are_refused(monkeypatch):
    """Each of 30 objects references the one before twice: a thousand million meshes."""
    text = SCENE
    for level in range(30):
        before = f"/level{level - 1}" if level else "/root/roof"
        parts = "".join(f'def "{half}" (references = <{before}>) {{}}\n' for half in "ab")
        text += f'def "level{level}" {{\n{parts}}}\n'
    file = read(text.encode(), "usda")
    assert len(file.mesh.faces) == 4
    with pytest.raises(io.ReadError, match="the objects of this scene need"):
        file.content()
