"""Copies of vertices at seams in meshes of other libraries move as one vertex."""

import numpy as np
import pytest
from shapes import icosphere, noisy

import cascadenorm as cn

BALL = noisy(icosphere(2), 0.2)
METHOD = {"method": "bilateral-normal"}


def test_seams_of_trimesh_stay_closed():
    trimesh = pytest.importorskip("trimesh")
    beyond = BALL.vertices[BALL.faces].mean(axis=1)[:, 0] > 0.1
    own = np.intersect1d(BALL.faces[beyond], BALL.faces[~beyond])  # on the seam: the faces beyond it have copies
    number = np.arange(len(BALL.vertices))
    number[own] = len(BALL.vertices) + np.arange(len(own))
    faces = np.where(beyond[:, None], number[BALL.faces], BALL.faces)
    source = np.concatenate([np.arange(len(BALL.vertices)), own])
    split = trimesh.Trimesh(BALL.vertices[source], faces, process=False)
    np.testing.assert_array_equal(cn.denoise(split, **METHOD).vertices, cn.denoise(BALL, **METHOD).vertices[source])
    for name, one, several in (
        ("fixed", [number[own[3]]], [own[3]]),
        ("fixed", np.arange(len(source)) == number[own[3]], [own[3]]),
        ("mask", np.arange(len(source)) != number[own[3]], np.arange(162) != own[3]),
        ("creases", number[BALL.faces[beyond][0, :2]][None], BALL.faces[beyond][0, :2][None]),
    ):
        out = cn.denoise(split, **METHOD, **{name: one}).vertices
        expected = cn.denoise(BALL, **METHOD, **{name: several}).vertices
        np.testing.assert_array_equal(out, expected[source])
    for name, wrong, message in (
        ("fixed", [len(source) - 1, 1000], f"references vertex 1000; there are {len(source)} vertices"),
        ("fixed", np.zeros(162, bool), rf"must be \({len(source)},\) bool"),
        ("mask", np.ones(162), rf"must be \({len(source)},\) bool"),
        ("creases", [number[BALL.faces[beyond][0, :2]], [0, 1000]], "has 1 of 2 pairs that are not edges"),
    ):
        with pytest.raises(cn.ParameterError, match=message):
            cn.denoise(split, **METHOD, **{name: wrong})
