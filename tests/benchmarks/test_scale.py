"""The figures of the plan for many scans and for one huge mesh follow from those that were measured."""

import pytest

from benchmarks.speed import scale

MEASURED = (
    ("auto", "100 k faces", 3.0, 0.5),
    ("auto", "1 M faces", 12.0, 1.0),
    ("taubin", "1 M faces", 2.0, 1.0),
    ("PyMeshLab two-step", "100 k faces", 1.0, 0.1),
    ("PyMeshLab two-step", "1 M faces", 9.0, 0.2),
)
COMMANDS = {"runs": [dict(zip(("name", "size", "seconds", "gibibytes"), run, strict=True)) for run in MEASURED]}


def test_times_memory_and_cost_are_those_of_the_formulas():
    methods = scale.rates(COMMANDS)
    assert list(methods) == ["auto"]  # taubin was measured at one size, and PyMeshLab is another library
    assert methods["auto"].start == pytest.approx(2.0) and methods["auto"].slope == pytest.approx(1e-5)
    row = scale.scans_table(4, methods, 1e6, 9e5, 0.1, 0.02).splitlines()[-1]
    # 4 threads · 1e6 scans · 9 s / 3600 s = 10,000 core hours; eight requests a scan
    assert row == "| auto | 10,000 | 10.0 | 0.97 | 1,000 | 160 |"
    rows = scale.huge_table(methods, 3.6e9).splitlines()
    # 350 bytes a face, and 900 for each of 4 million faces of a patch
    assert rows[-2] == "| auto, in memory | 10.0 | 3,865 |" and rows[-1].endswith("in patches | – | 1,264 |")
