"""Patches of a mesh on a Dask cluster give the result of this process."""

import pytest
from batches import LINUX
from test_patches import AGREES, BALL, RIBBON, place  # noqa: F401 - a fixture

import cascadenorm as cn
from cascadenorm.api import patch_sizes
from cascadenorm.io.interop import save_mesh


@LINUX
@pytest.mark.parametrize("method", ["bilateral-normal", "auto"])
def test_workers_give_the_result_of_this_process(place, cluster, method, monkeypatch):  # noqa: F811
    monkeypatch.setattr(patch_sizes, "MAX_PATCH_FACES", 2400)
    save_mesh(place / "scan.ply", RIBBON if method == "auto" else BALL)
    whole = cn.denoise_file("scan.ply", "whole.ply", method=method)
    there = cn.denoise_file("scan.ply", "there.ply", method=method, memory=2500, scheduler=cluster[0])
    assert there.moved == whole.moved
    one, other = cn.read("whole.ply").mesh, cn.read("there.ply").mesh
    assert abs(one.vertices - other.vertices).max() < AGREES * one.mean_edge_length
