"""Plots of evaluations: where boxes, dots and means lie."""

import re

import numpy as np
import pytest

from cascadenorm.render.style import ACCENTS
from cascadenorm.reports.evaluations import QUANTILES, box_plot

VALUES = {"noisy": np.linspace(10, 60, 101), "<b>": np.linspace(1, 5, 101) ** 2}


def scale(element):
    """Slope and offset of the axis: values to places, by its numbers."""
    marks = re.findall(r"text-anchor: middle; fill: currentColor\" x=\"([\d.]+)\"[^>]*>(\d+)</text>", element)
    return np.polyfit([float(value) for _, value in marks], [float(x) for x, _ in marks], 1)


def lines(element, color):
    """Horizontal places of the two ends of each line of a colour."""
    found = re.findall(
        rf'd="M ([\d.]+) [\d.]+ L ([\d.]+) [^"]*"[^>]*style="[^"]*stroke: {color}', element.replace("\n", "")
    )
    return np.array(found, float)


def test_boxes_and_whiskers_end_at_the_quantiles():
    element = box_plot(VALUES, title="Spread", label="angle (°)")
    spread = np.array([np.quantile(values, list(QUANTILES.values())) for values in VALUES.values()])
    slope, offset = scale(element)
    places = slope * spread + offset
    medians = lines(element, ACCENTS[0])
    assert medians == pytest.approx(np.stack([places[:, 2], places[:, 2]], axis=1), abs=0.1)
    whiskers = [tuple(sorted(pair)) for pair in lines(element, "currentColor")]
    for low, first, _, third, high in places:
        for ends in ((low, first), (third, high)):
            assert any(pair == pytest.approx(ends, abs=0.1) for pair in whiskers)
    assert 'aria-label="Spread. noisy: median 35.00; &lt;b&gt;: median 9.00"' in element
    assert ">Spread</text>" in element and ">angle (°)</text>" in element and ">&lt;b&gt;</text>" in element


def test_a_plot_has_no_paper():
    assert "#ffffff" not in box_plot(VALUES, title="", label="")
