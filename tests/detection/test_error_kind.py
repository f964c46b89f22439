"""The kind of error is told from meshes whose error is known."""

import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy
from voxels import extracted, volume

import cascadenorm as cn
from cascadenorm.api.inspection import inspect
from cascadenorm.cli import run
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.noise.sensor import laser_displacements
from cascadenorm.data_gen.scanning.volumes import surface_nets
from cascadenorm.detection import error_kind as kinds
from cascadenorm.detection.error_kind import ErrorKind, NameOfKind, correlation_length, error_kind
from cascadenorm.detection.segmentation_steps import is_segmentation
from cascadenorm.detection.voxel_lattice import lattice_of_mask
from cascadenorm.io.interop import save_mesh

BALL = icosphere(5)


def test_the_correlation_length_is_that_of_the_field():
    """A moving average over a radius has an autocorrelation that falls to 1/e before twice the radius."""
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 60, (40000, 2))
    points = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
    waves = 2 * np.pi * rng.normal(size=(400, 3)) / (2 * np.pi)  # a spectrum of deviation 1: correlation exp(-r²/2)
    values = np.cos(points @ waves.T + rng.uniform(0, 2 * np.pi, 400)).sum(axis=1)
    assert correlation_length(points, values) == pytest.approx(np.sqrt(2), rel=0.15)
    assert correlation_length(points, rng.normal(size=len(points))) < 1


@pytest.mark.parametrize("wavelength", [0.3, 1.0, 1.8, 2.0, 5.0, 20.0])
def test_the_correlation_length_does_not_depend_on_a_first_look_at_near_points(monkeypatch, wavelength):
    rng = np.random.default_rng(5)
    points = np.concatenate([rng.uniform(0, 40, (3000, 2)), np.zeros((3000, 1))], axis=1)
    waves = rng.normal(size=(100, 3)) / wavelength
    values = np.cos(points @ waves.T + rng.uniform(0, 2 * np.pi, 100)).sum(axis=1)
    found = correlation_length(points, values)
    monkeypatch.setattr(kinds, "CORRELATION_REACHES", (12.0, 12.0))
    assert found == correlation_length(points, values)


@pytest.mark.parametrize("level", [0.1, 0.3])
def test_noise_of_each_vertex_is_independent(level):
    found = error_kind(noisy(BALL, level), BALL.vertices)
    assert (found.kind, found.sure) == ("independent", True)
    assert found.size == pytest.approx(level, rel=0.05)
    assert str(found) == f"independent noise of {found.size:.2g} edges"


def test_an_error_alike_over_several_edges_is_correlated_over_them():
    waves = np.sin(np.pi * BALL.vertices @ np.random.default_rng(0).normal(size=(3, 40)) / (4 * BALL.mean_edge_length))
    error = 0.3 * BALL.mean_edge_length * (waves.sum(axis=1) / np.sqrt(20))
    bumpy = BALL.moved(BALL.vertices * (1 + error[:, None]))
    found = error_kind(bumpy, BALL.vertices)
    assert (found.kind, found.sure) == ("correlated", True)
    assert 1.5 < found.length < 6
    assert f"edges, correlated over about {found.length:.2g} edges" in str(found)


def test_a_measured_sheet_seen_from_one_side_is_a_depth_image():
    sheet = grid(40, 40)
    assert not error_kind(noisy(sheet, 0.2), sheet.vertices).sure
    found = error_kind(noisy(sheet, 0.2), sheet.vertices, measured=True)
    assert (found.kind, found.sure) == ("depth image", True)
    assert str(found) == f"error of {found.size:.2g} edges in a depth image or a laser scan"


def test_an_open_sheet_with_noise_on_its_vertices_is_no_depth_image():
    sheet = grid(60, 60)
    x, y = sheet.vertices[:, :2].T * 2 * np.pi / 60
    hills = sheet.moved(np.column_stack([sheet.vertices[:, :2], 4 * np.sin(2 * x) * np.cos(1.5 * y)]))
    found = inspect(noisy(hills, 0.2))
    assert found.treated_as.treatment == "vertex-noise"
    assert (found.error.kind, found.error.sure) == ("independent", True)


def test_a_laser_scan_is_not_taken_for_a_segmentation():
    """Its error, which is alike along rows of the scanner, bends the surface to and fro as the steps of a mask do."""
    rows = grid(60, 60)
    x, y = (rows.vertices[:, :2] - 30).T * [[2.2], [1]]
    dome = rows.moved(np.stack([x, y, np.sqrt(88**2 - x**2 - y**2)], axis=1))
    scan = dome.moved(dome.vertices + laser_displacements(dome, 0.1, rng=np.random.default_rng(0)))
    assert is_segmentation(scan)
    found = error_kind(scan, dome.vertices, measured=True)
    assert (found.kind, found.sure) == ("depth image", True)
    assert str(found) == f"error of {found.size:.2g} edges in a depth image or a laser scan"


def test_little_is_no_error():
    found = error_kind(noisy(BALL, 0.003), BALL.vertices)
    assert (found.kind, found.length, str(found)) == ("none", None, "no significant error")


def test_inspect_and_denoise_say_what_they_find(tmp_path, capsys):
    voxel = np.array((0.5, 0.5, 1.5))
    mesh = extracted(np.where(volume("egg", voxel, 60) > 0, 0.5, -0.5), voxel)
    path = tmp_path / "mask.ply"
    save_mesh(path, mesh)
    found = inspect(path).error
    assert found.kind == "segmentation"
    np.testing.assert_allclose(sorted(found.voxel), sorted(voxel), rtol=1e-3)
    report = cn.denoise_file(path, tmp_path / "smooth.ply")
    assert (report.error.kind, report.error.sure) == (found.kind, found.sure)
    assert (report.error.size, report.error.length) == pytest.approx((found.size, found.length))
    assert cn.denoise_file(path, tmp_path / "same.ply", strength=0).error is None
    assert run(["inspect", str(path)]) == 0
    assert f"kind of error: {found}" in capsys.readouterr().out


def test_a_segmentation_whose_voxels_are_lost_is_told_by_its_steps():
    mesh = surface_nets(np.where(volume("egg", (1.0, 1.0, 1.0)) > 0, 1.0, 0.0))
    assert lattice_of_mask(mesh) is None
    found = inspect(mesh).error
    assert (found.kind, found.sure, found.voxel) == ("segmentation", False, None)
    assert str(found).startswith("probably steps of 0.") and str(found).endswith("edges from a binary segmentation")


def test_exact_geometry_has_no_error():
    assert inspect(cube(6)).error.kind == "none"


def test_noise_that_is_drawn_correlated_is_not_independent():
    rng = np.random.default_rng(2)
    lengths = []
    for _ in range(6):
        moved = displacements(BALL, "correlated", level=0.3, rng=rng)
        lengths.append(error_kind(BALL.moved(BALL.vertices + moved), BALL.vertices).length)
    assert np.median(lengths) > 1.2


def test_each_kind_has_its_own_description_and_is_documented():
    kinds = get_args(NameOfKind)
    found = {str(ErrorKind(kind=kind, sure=True, size=0.2, length=2.0, voxel=None)) for kind in kinds}
    assert len(found) == len(kinds)
    page = (Path(__file__).parents[2] / "docs" / "json.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| `kind` \|.*", page, re.MULTILINE)
    assert [kind for kind in kinds if f"`{kind}`" not in row] == []
