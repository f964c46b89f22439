"""Fields hold what was measured at each vertex or face of the surface."""

import numpy as np
import pytest
from shapes import grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.geometry.fields import fields
from cascadenorm.mesh import Mesh

CLEAN = icosphere(3)
ROUGH = noisy(CLEAN, 0.2)


def test_a_lifted_plane_has_moved_along_its_normal_by_its_height():
    plane = grid(3, 4)
    lifted = plane.moved(plane.vertices + np.array([0, 0, -0.25]))
    found = {field.name: field for field in fields({"before": plane, "after": lifted, "truth": plane}, unit=8.0)}
    np.testing.assert_allclose(found["displacement"].values["after"], 2.0)
    np.testing.assert_allclose(found["normal-displacement"].values["before"], -2.0)
    np.testing.assert_allclose(found["distance"].values["after"], 2.0)
    np.testing.assert_allclose(found["distance"].values["before"], 0.0, atol=1e-12)
    assert (found["angle"].values["after"] == 0).all() and (found["normal-error"].values["after"] == 0).all()
    assert found["normal-displacement"].limits == (-2.0, 2.0) and found["displacement"].limits == (0.0, 2.0)


def test_fields_of_angles_are_what_compare_measures():
    out = cn.denoise(ROUGH, method="laplacian")
    found = {field.name: field for field in fields({"before": ROUGH, "after": out, "truth": CLEAN}, unit=1.0)}
    for key, mesh in (("before", ROUGH), ("after", out)):
        assert found["normal-error"].values[key].mean() == cn.compare(mesh, CLEAN).normal_error_deg
    assert found["angle"].values["after"].mean() == cn.compare(out, ROUGH).normal_error_deg


BACK_FACES = [*ROUGH.faces, *ROUGH.faces[:, ::-1]]
MIXED = [face[:: 1 if number % 3 else -1] for number, face in enumerate(ROUGH.faces)]


@pytest.mark.parametrize(
    ("faces", "names"),
    [
        pytest.param(BACK_FACES, ["noise", "curvature", "normal-displacement"], id="every face twice"),
        pytest.param([*ROUGH.faces, (0, 0, 1)], ["noise", "curvature", "normal-displacement"], id="a repeated vertex"),
        pytest.param(MIXED, ["noise"], id="every third face flipped"),
    ],
)
def test_fields_on_vertices_are_those_of_the_surface(faces, names):
    moved = ROUGH.vertices + 0.01 * np.sin(7 * ROUGH.vertices)
    sound, other = (
        fields({"before": Mesh(ROUGH.vertices, every), "after": Mesh(moved, every)}, unit=1.0)
        for every in (ROUGH.faces, faces)
    )
    for one, expected in zip(other, sound, strict=True):
        if one.name in names:
            for key, values in expected.values.items():
                np.testing.assert_allclose(one.values[key], values, atol=1e-12)
