"""The meshes of a layer and the values of their vertices are found wherever it defines them."""

import re

import numpy as np
import pytest
from sample_files import read
from shapes import icosphere
from usd_layers import SCENE, with_attributes

import cascadenorm as cn
from cascadenorm import io

pytest.importorskip("pxr")


def test_meshes_of_all_variants_are_moved_and_the_selected_one_is_shown():
    mesh = """{{
            def Mesh "m"
            {{
                int[] faceVertexCounts = [3]
                int[] faceVertexIndices = [0, 1, 2]
                point3f[] points = [(0, 0, 0), ({}, 0, 0), (0, 1, 0)]
            }}
        }}"""
    text = f"""#usda 1.0
def Xform "a" (
    variants = {{ string size = "large" }}
    prepend variantSets = "size"
)
{{
    variantSet "size" = {{
        "small" {mesh.format(1)}
        "large" {mesh.format(2)}
    }}
}}
"""
    file = read(text.encode(), "usda")
    assert file.positions[[1, 4], 0].tolist() == [1, 2]
    moved = read(b"".join(file.with_vertices(file.mesh.vertices * 3).pieces()), "usda")
    assert sorted(moved.positions[[1, 4], 0].tolist()) == [3, 6]  # OpenUSD sorts variants by their names
    assert moved.content().positions[:, 0].tolist() == [0, 6, 0]


def test_animated_points_are_refused():
    points = re.search(r"point3f\[\] points = (\[.*\])", SCENE)
    frames = f"point3f[] points.timeSamples = {{ 1: {points[1]}, 2: {points[1]} }}"
    with pytest.raises(io.ReadError, match=r"/root/roof\.points is animated: export a single frame"):
        read(SCENE.replace(points[0], frames).encode(), "usda")
    one = read(SCENE.replace(points[0], f"point3f[] points.timeSamples = {{ 7: {points[1]} }}").encode(), "usda")
    again = read(b"".join(one.with_vertices(one.mesh.vertices + 1).pieces()), "usda")
    assert np.array_equal(again.positions, one.positions + 1)


def test_one_colour_of_a_mesh_is_that_of_its_vertices():
    content = read(with_attributes("color3f[] primvars:displayColor = [(1, 0, 0.2)]"), "usda").content()
    assert {name: {*value.tolist()} for name, value in content.vertex_values.items()} == {
        "red": {255},
        "green": {0},
        "blue": {51},
    }


@pytest.mark.parametrize("format", ["vtp", "vtu", "ply", "usda"])
def test_truth_values_and_half_precision_can_be_converted(format, tmp_path):
    pytest.importorskip({"vtp": "vtkmodules", "vtu": "meshio"}.get(format, "numpy"))
    flags = 'bool[] primvars:flag = [1, 0, 0, 1, 0, 1] (interpolation = "vertex")'
    halves = 'half[] primvars:heat = [0.5, 1, 2, 3, 4, 5] (interpolation = "vertex")'
    io.write(read(with_attributes(flags + "\n" + halves), "usda"), tmp_path / f"a.{format}")
    found = cn.read(tmp_path / f"a.{format}").content().vertex_values
    assert found["flag"].tolist() == [1, 0, 0, 1, 0, 1] * 2 and found["heat"].tolist() == [0.5, 1, 2, 3, 4, 5] * 2


def test_values_of_vertices_are_those_of_their_mesh_in_any_order_of_the_scene():
    """The values are the coordinates x, indexed, so that a vertex with the value of another one is seen."""
    ball, text = icosphere(1), "#usda 1.0\n"
    for kind, name, shift in ("class", "a", 0), ("def", "b", 5):
        text += f"""{kind} Mesh "{name}" {{
            point3f[] points = {[tuple(row) for row in (ball.vertices + shift).tolist()]}
            int[] faceVertexCounts = {[3] * len(ball.faces)}
            int[] faceVertexIndices = {ball.faces.ravel().tolist()}
            float[] primvars:weight = {(ball.vertices[::-1, 0] + shift).tolist()} (interpolation = "vertex")
            int[] primvars:weight:indices = {list(range(len(ball.vertices)))[::-1]}
            float primvars:number = 3 (interpolation = "vertex")
            float[] primvars:wide.timeSamples = {{ 1: [1], 2: [2] }}
        }}
"""
    shown = [f'def "{name}" (references = </a>)\n{{\n}}\n' for name in "cd"]
    for scene in "", shown[0], shown[0] + shown[1]:
        file = read((text + scene).encode(), "usda")
        assert {*file.vertex_values} == {"weight"}
        np.testing.assert_array_equal(file.vertex_values["weight"], file.positions[:, 0])
    bad = text.replace("weight:indices = [", "weight:indices = [99, ").replace(", 0]", "]")
    assert "weight" not in read(bad.encode(), "usda").vertex_values
