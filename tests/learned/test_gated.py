"""Each component goes through the network that the gate chooses, and one file holds all networks."""

from dataclasses import replace

import numpy as np
import pytest
from gates import OPEN
from shapes import grid, icosphere, noisy, side_by_side

import cascadenorm as cn
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.gated import GatedCascades, read_model
from cascadenorm.learned.methods import mesh_treatment, shipped


@pytest.fixture(scope="module")
def gated() -> GatedCascades:
    """The networks of `auto` and of `cascade`, which differ in what they make of anything, behind the gate above."""
    auto = shipped("auto")
    return GatedCascades(auto.vertex, shipped("cascade"), OPEN, {"note": "for a test"})


def test_each_component_goes_through_its_network(gated):
    sheet, ball = noisy(grid(20, 20), 0.2), noisy(icosphere(3), 0.2)
    mesh = side_by_side(sheet, ball)
    vertices = gated.vertices(mesh)
    parts = side_by_side(sheet.moved(gated.surface.vertices(sheet)), ball.moved(gated.vertex.vertices(ball)))
    np.testing.assert_allclose(vertices, parts.vertices, atol=1e-9)
    np.testing.assert_array_equal(gated.vertices(ball), gated.vertex.vertices(ball))
    np.testing.assert_array_equal(gated.vertices(sheet), gated.surface.vertices(sheet))


def test_a_file_holds_both_networks_and_the_gate(gated, tmp_path):
    path = tmp_path / "both.safetensors"
    path.write_bytes(gated.to_bytes())
    again = read_model(path)
    assert isinstance(again, GatedCascades)
    assert again.to_bytes() == gated.to_bytes()
    assert again.card["gate"] == {"note": "for a test"}
    assert again.second_gate is None
    with pytest.raises(cn.ParameterError, match="cascadenorm-gated"):
        Cascade.load(path)


def test_strong_noise_has_its_own_later_stages(tmp_path):
    auto = shipped("auto")
    others = Cascade((auto.vertex.stages[0], *auto.surface.stages[1:]), {"note": "for strong noise"})
    gated = GatedCascades(auto.vertex, auto.surface, OPEN, {"note": "for a test"}, others)
    little, strong = noisy(icosphere(3), 0.02), noisy(icosphere(3), 0.2)
    little = little.moved(little.vertices * strong.mean_edge_length / little.mean_edge_length)
    np.testing.assert_array_equal(gated.vertices(strong), others.vertices(strong))
    np.testing.assert_array_equal(gated.vertices(little), replace(gated, strong=None).vertices(little))
    assert not np.allclose(gated.vertices(strong), gated.vertex.vertices(strong))
    both = side_by_side(little.moved(gated.vertices(little)), strong.moved(gated.vertices(strong)))
    np.testing.assert_allclose(gated.vertices(side_by_side(little, strong)), both.vertices, atol=1e-6)
    path = tmp_path / "three.safetensors"
    path.write_bytes(gated.to_bytes())
    again = read_model(path)
    assert isinstance(again, GatedCascades) and again.to_bytes() == gated.to_bytes()
    assert again.strong is not None and again.strong.begins_like(auto.vertex)
    assert again.card["strong"] == {"note": "for strong noise"}
    np.testing.assert_array_equal(again.vertices(strong), gated.vertices(strong))


def test_what_a_mesh_is_treated_as_can_be_overruled(gated, tmp_path):
    path = tmp_path / "both.safetensors"
    path.write_bytes(gated.to_bytes())
    ball = noisy(icosphere(3), 0.2)
    assert str(mesh_treatment(ball, model=path)) == "vertex noise (probability 0.90)"
    assert str(mesh_treatment(ball, model=path, treat_as="measured-surface")) == "measured surface (as set)"
    assert str(mesh_treatment(ball, model=path, treat_as="unknown")) == "unknown"
    mixed = side_by_side(ball, noisy(grid(8, 8), 0.1))
    share = f"{100 * len(ball.faces) // len(mixed.faces)}%"
    assert str(mesh_treatment(mixed, model=path)) == f"vertex noise (probability 0.90, {share} of the faces)"
    asked = cn.denoise(ball, model=path, treat_as="measured-surface").vertices
    default = cn.denoise(ball, model=path).vertices
    assert not np.allclose(asked, default)
    np.testing.assert_array_equal(cn.denoise(ball, model=path, treat_as="vertex-noise").vertices, default)
    with pytest.raises(cn.ParameterError, match="measured-surface"):
        cn.denoise(ball, model=path, treat_as="statue")
