"""Small components are found by number and by share."""

import numpy as np
import pytest
from components import LARGE, MIDDLE, PARTS, SMALL, in_a_row

import cascadenorm as cn
from cascadenorm.errors import ParameterError
from cascadenorm.geometry.small_components import component_limit, small_components
from cascadenorm.mesh import Mesh


@pytest.mark.parametrize(
    ("limit", "dropped"),
    [(1, []), (12, []), (13, [0, 3]), ("80", [0, 3]), ("81", [0, 2, 3]), (10**9, [0, 2, 3]),
     ("1%", [0, 3]), ("0.2 %", []), ("2%", [0, 2, 3]), ("100%", [0, 2, 3])],
)  # fmt: skip
def test_components_are_small_by_number_or_by_share(limit, dropped):
    mesh = in_a_row(*PARTS)
    owners = np.repeat(np.arange(4), [len(part.faces) for part in PARTS])
    faces, first = small_components(mesh, limit)
    np.testing.assert_array_equal(faces, np.isin(owners, dropped))
    np.testing.assert_array_equal(first, [np.flatnonzero(owners == number)[0] for number in dropped])


def test_a_component_with_exactly_the_share_is_not_small():
    fan = Mesh([[0, 0, 0], *([np.cos(k), np.sin(k), k] for k in range(101))], [[0, k, k + 1] for k in range(1, 101)])
    for count in range(1, 100):  # 0.07 · 100 is above 7
        mesh = in_a_row(Mesh(fan.vertices, fan.faces[:count]), fan)
        assert not small_components(mesh, f"{count}%")[0].any()
        assert small_components(mesh, f"{count}.1 %")[0].sum() == count


def test_of_components_of_one_size_all_are_the_largest():
    assert not small_components(in_a_row(SMALL, SMALL), "100%")[0].any()
    assert not small_components(in_a_row(SMALL, SMALL), 1000)[0].any()


@pytest.mark.parametrize("limit", ["", "much", "0", 0, -3, "101%", "1.5", "5 faces", "9" * 5000])
def test_what_is_no_size_is_refused(limit):
    with pytest.raises(ParameterError, match="drop_components is"):
        component_limit(limit)


def test_an_inspection_counts_small_components_and_names_a_face_of_each():
    found = cn.inspect(in_a_row(*PARTS)).small_components
    assert (found.count, found.first) == (2, (0, 12 + 5120 + 80))
    assert cn.inspect(in_a_row(LARGE, MIDDLE)).small_components.count == 0
