"""Colours of heat maps, and the table that the viewer shares."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cascadenorm.render.color import color_map, linear

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "cascadenorm" / "render" / "colors.json"
CONES = [
    (0.41222147, 0.53633254, 0.05144599),
    (0.2119035, 0.68069955, 0.10739696),
    (0.08830246, 0.28171884, 0.6299787),
]
LAB = [
    (0.21045426, 0.79361778, -0.00407205),
    (1.9779985, -2.42859221, 0.45059371),
    (0.02590404, 0.78277177, -0.80867577),
]
"""Linear sRGB to the cones of OKLab, and the cube roots of those to lightness and two hues (Ottosson 2020)."""
SEEN = {  # linear light as eyes without red or green cones see it (Viénot, Brettel, Mollon 1999)
    "all cones": np.eye(3),
    "protanopia": [(0.11238, 0.88762, 0), (0.11238, 0.88762, 0), (0.00401, -0.00401, 1)],
    "deuteranopia": [(0.29275, 0.70725, 0), (0.29275, 0.70725, 0), (-0.02234, 0.02234, 1)],
}


def perceived(*, signed, seen="all cones"):
    """The colours of a heat map in OKLab."""
    light = np.clip(linear(color_map(signed=signed)) @ np.transpose(SEEN[seen]), 0, 1)
    return np.cbrt(light @ np.transpose(CONES)) @ np.transpose(LAB)


def test_the_table_is_what_its_script_writes(tmp_path):
    script = ROOT / "docs" / "generate" / "color_table.py"
    subprocess.run([sys.executable, script, tmp_path / "colors.json"], check=True)
    assert TABLE.read_bytes() == (tmp_path / "colors.json").read_bytes()


@pytest.mark.parametrize("bundle", ["reports/viewer.js", "studio/studio.js"])
def test_the_bundles_for_the_browser_have_the_colors_of_the_package(bundle):
    text = (ROOT / "cascadenorm" / bundle).read_text(encoding="utf-8")
    for signed in (False, True):
        assert np.rint(255 * color_map(signed=signed)).astype(np.uint8).tobytes().hex() in text


def test_zero_is_light_and_lightness_falls_in_even_steps():
    lightness = perceived(signed=False)[:, 0]
    assert lightness[0] > 0.95 and lightness[-1] < 0.35
    assert np.diff(lightness[::15]) == pytest.approx(np.ptp(lightness) / -17, rel=0.15)


def test_signed_values_are_blue_and_orange_on_both_sides_of_light_grey():
    signed = color_map(signed=True)
    assert np.ptp(signed[127]) < 0.02 and signed[0, 2] > signed[0, 0] + 0.3 and signed[-1, 0] > signed[-1, 2] + 0.3
    lightness = perceived(signed=True)[:, 0]
    assert lightness[127] > 0.9
    assert all((np.diff(side) >= -0.004).all() for side in (lightness[:128], lightness[:127:-1]))


@pytest.mark.parametrize("seen", SEEN)
def test_colors_of_values_are_told_apart_by_the_color_blind(seen):
    """Values an eighth of the scale apart, and for signed ones those of equal size on both sides of 0."""
    colors = perceived(signed=False, seen=seen)
    apart = np.linalg.norm(colors[32:] - colors[:-32], axis=1)
    assert apart.min() > 0.06 and apart.max() < 2 * apart.min()
    below, above = (perceived(signed=True, seen=seen)[side][:96] for side in (np.s_[:], np.s_[::-1]))
    assert np.linalg.norm(below - above, axis=1).min() > 0.05
