"""Bumps of one width are found with their width; bodies, noise and rough terrain have none."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.detection.bumps import bumps
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh

SHEET = grid(130, 130)


def waves(width: float, height: float = 0.5) -> Mesh:
    """Return a sheet with bumps and hollows of this width; width and height are in mean edge lengths.

    Over all directions, the autocorrelation of the product of two sines is the Bessel function J0, whose first minimum
    lies at 3.83. With half waves as wide as the bumps, this is at 0.86 of their width.
    """
    edge = SHEET.mean_edge_length
    x, y = np.pi * SHEET.vertices[:, :2].T / (width * edge)
    vertices = SHEET.vertices.copy()
    vertices[:, 2] = height * edge * np.sin(x) * np.sin(y)
    return SHEET.moved(vertices)


@pytest.mark.parametrize("width", [7.0, 10.0, 14.0])
@pytest.mark.parametrize("scale", [1e-12, 1.0])
def test_bumps_are_found_with_their_width(width, scale):
    made = waves(width)
    assert bumps(made.moved(made.vertices * scale)).width == pytest.approx(width, rel=0.15)


@pytest.mark.parametrize("noise", [0.03, 0.08])
def test_noise_does_not_hide_them(noise):
    assert bumps(noisy(waves(10.0), noise)).width == pytest.approx(10.0, rel=0.15)


def rough() -> Mesh:
    """Return a sheet whose heights have all wavelengths, like terrain."""
    rng = np.random.default_rng(0)
    vertices = SHEET.vertices.copy()
    for length in np.geomspace(4, 90, 60):
        angle, phase = rng.uniform(0, 2 * np.pi, 2)
        along = vertices[:, :2] @ (np.cos(angle), np.sin(angle)) / SHEET.mean_edge_length
        vertices[:, 2] += 0.02 * length * np.sin(2 * np.pi * along / length + phase) * SHEET.mean_edge_length
    return SHEET.moved(vertices)


@pytest.mark.parametrize(
    "mesh",
    [
        icosphere(4),
        cube(20),
        noisy(icosphere(4), 0.2),
        SHEET,
        noisy(SHEET, 0.2),
        waves(3.0),
        rough(),
        waves(10.0, 0.01),
    ],
)
def test_other_surfaces_have_none(mesh):
    assert bumps(mesh) is None


def test_rounded_edges_are_no_bumps():
    """Ridges along the edges of a box alternate with its sides, as bumps do with hollows."""
    box = cube(80)
    inner = np.clip(box.vertices, -0.8, 0.8)
    outward = box.vertices - inner
    lengths = np.linalg.norm(outward, axis=1, keepdims=True)
    rounded = box.moved(inner + 0.2 * outward / np.where(lengths > 0, lengths, 1))
    assert bumps(rounded) is None


def test_few_bumps_are_the_shape():
    few = grid(30, 30)
    x, y = np.pi * few.vertices[:, :2].T / (10 * few.mean_edge_length)
    heights = np.zeros_like(few.vertices)
    heights[:, 2] = few.mean_edge_length * np.sin(x) * np.sin(y)
    assert bumps(few.moved(few.vertices + heights)) is None


def test_many_small_bodies_are_no_bumps():
    ball, places = icosphere(4), 3.0 * np.arange(5)
    vertices = np.concatenate([ball.vertices + np.eye(3)[0] * place for place in places])
    faces = np.concatenate([ball.faces + i * len(ball.vertices) for i in range(len(places))])
    assert bumps(Mesh(vertices, faces)) is None


def test_inspect_names_the_option_and_its_width_as_a_possibility(tmp_path, capsys):
    made = waves(10.0)
    save_mesh(tmp_path / "a.ply", made)
    assert run(["inspect", str(tmp_path / "a.ply")]) == 0
    width = int(np.ceil(cn.inspect(made).bumps.width))
    assert f'if they are an error, as of particles, remove them with --remove-detail "{width} edges"' in (
        " ".join(capsys.readouterr().out.split())
    )
    flat = cn.denoise(made, remove_detail=f"{width} edges").vertices[:, 2]
    inner = np.abs(SHEET.vertices[:, :2] - SHEET.vertices[:, :2].mean(axis=0)).max(axis=1) < 0.3 * np.ptp(
        SHEET.vertices
    )
    assert np.std(flat[inner]) < 0.5 * np.std(made.vertices[inner, 2])
