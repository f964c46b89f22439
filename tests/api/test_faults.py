"""Faults that are counted before and after denoising."""

import json

import numpy as np
import pytest
from shapes import cube, icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.inspection.defects import SPIKE, spikes
from cascadenorm.api.inspection.inspection import surface_faults
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh

BALL = icosphere(3)


@pytest.mark.parametrize("pointed", [False, True])
def test_a_vertex_is_a_spike_where_its_angles_add_up_to_little(pointed):
    """Six triangles on a regular hexagon of side 1: each has the angle 2 asin(1 / (2 s)) at the apex, of sides s."""
    turn = np.arange(6) * np.pi / 3
    side = 0.5 / np.sin(SPIKE / 12) * (1.001 if pointed else 0.999)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(6)], axis=1)
    apex = (0, 0, np.sqrt(side**2 - 1))
    faces = [(i, (i + 1) % 6, 6) for i in range(6)]
    for flipped in (faces, [face[::-1] for face in faces]):
        found = spikes(Mesh(np.vstack([ring, apex]), flipped))
        assert found.tolist() == [False] * 6 + [pointed]


def test_smooth_surfaces_and_corners_have_none():
    for mesh in (BALL, cube(4), noisy(BALL, 0.1)):
        assert surface_faults(mesh) == {"crossing_faces": 0, "spikes": 0}


def test_denoise_counts_them_before_and_after(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    vertices = BALL.vertices.copy()
    vertices[7] *= 1.6
    vertices[100] *= -1.5  # through the other side
    save_mesh(tmp_path / "ball.ply", Mesh(vertices, BALL.faces))
    words = [
        "denoise",
        "ball.ply",
        "-o",
        "out.ply",
        "--method",
        "laplacian",
        "--set",
        "iterations=100",
        "--json",
        "--force",
    ]
    assert run(words) == 0
    told = json.loads(capsys.readouterr().out)
    found = cn.inspect("ball.ply")
    assert told["spikes"] == {"before": 2, "after": 0} and found.spikes.count == 2
    assert told["crossing_faces"]["before"] == found.crossing_faces.count > 0 == told["crossing_faces"]["after"]
    monkeypatch.setattr("cascadenorm.api.inspection.inspection.MOST_FACES_CROSSED", 10)
    assert run(words) == 0
    assert json.loads(capsys.readouterr().out)["crossing_faces"] == {"before": None, "after": None}
