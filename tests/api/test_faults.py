"""Faults that are counted before and after denoising."""

import json

import numpy as np
import pytest
from shapes import cube, icosphere, noisy

import cascadenorm as cn
from cascadenorm.api.inspection.defects import SPIKE, folded_edges, spikes
from cascadenorm.api.inspection.inspection import new_faults, surface_faults
from cascadenorm.cli import run
from cascadenorm.cli.tables import print_new_faults
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
        assert surface_faults(mesh) == {"crossing_faces": 0, "spikes": 0, "folded_edges": 0}


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize(("angle", "folded"), [(89.9, False), (90, False), (90.1, True), (179, True)])
def test_an_edge_is_folded_where_the_normals_of_its_faces_are_more_than_a_right_angle_apart(angle, folded, flipped):
    turn = np.radians(angle)
    vertices = [(0, 0, 0), (0, 1, 0), (-1, 0, 0), (np.cos(turn), 0, np.sin(turn))]
    second = (3, 1, 0) if not flipped else (3, 0, 1)
    assert folded_edges(Mesh(vertices, [(0, 1, 2), second])).tolist() == [folded]


def test_the_report_counts_faces_that_cross_although_nothing_folds(tmp_path, monkeypatch, capsys):
    """Of two balls, one inside the other, the coarse outer one shrinks faster and cuts through the inner one."""
    monkeypatch.chdir(tmp_path)
    outer, inner = icosphere(1), icosphere(3)
    faces = np.concatenate([outer.faces, inner.faces + len(outer.vertices)])
    save_mesh(tmp_path / "balls.ply", Mesh(np.concatenate([outer.vertices, 0.9 * inner.vertices]), faces))
    words = ["denoise", "balls.ply", "--method", "laplacian", "--set", "iterations=1", "--force"]
    assert run([*words, "--report", "report.html"]) == 0
    assert "the result has" not in capsys.readouterr().err  # the search takes too long for every mesh
    after = cn.inspect("balls_denoised.ply").crossing_faces.count
    assert after > 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    tile = page[page.index("Self-intersecting faces") :][:400]
    assert f"{after}<" in tile
    assert "vertices; folded edges: 0\N{NO-BREAK SPACE}→\N{NO-BREAK SPACE}0" in page
    assert "edges folded by more than 90°" in page


def test_only_what_became_more_is_said(capsys, monkeypatch):
    def folded(angle: float) -> Mesh:
        turn = np.radians(angle)
        return Mesh([(0, 0, 0), (0, 1, 0), (-1, 0, 0), (np.cos(turn), 0, np.sin(turn))], [(0, 1, 2), (3, 1, 0)])

    assert new_faults(folded(10), folded(120)) == {"folded_edges": (0, 1)}
    print_new_faults({"spikes": (0, 1), "folded_edges": (3, 5)})
    assert "the result has 1 spike (0 before), 5 edges folded by more than 90° (3 before)\n" in capsys.readouterr().err
    for before, after in ((folded(120), folded(130)), (folded(120), folded(10))):
        assert new_faults(before, after) == {}
    print_new_faults({})
    assert capsys.readouterr().err == ""


def test_faces_that_cross_are_counted_where_the_result_has_new_folds(monkeypatch):
    def with_fin(angle: float) -> Mesh:
        """A sheet, and a triangle above it that turns about an edge of another one until it cuts the sheet."""
        turn = np.radians(angle)
        sheet = [(-2, -1, -0.5), (2, -1, -0.5), (0, 3, -0.5)]
        hinge = [(0, 0, 0), (0, 1, 0), (-1, 0, 0), (np.cos(turn), 0, -np.sin(turn))]
        return Mesh(np.array(sheet + hinge, float), [(0, 1, 2), (3, 4, 5), (6, 4, 3)])

    assert new_faults(with_fin(10), with_fin(100)) == {"crossing_faces": (0, 2), "folded_edges": (0, 1)}
    monkeypatch.setattr("cascadenorm.api.inspection.inspection.MOST_FACES_CROSSED", 1)
    assert new_faults(with_fin(10), with_fin(100)) == {"folded_edges": (0, 1)}


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


def test_faults_are_those_of_the_mesh_that_is_denoised(tmp_path, monkeypatch, capsys):
    """Back faces are no further faces that cross, and faces that repeat a vertex hide no spike."""
    monkeypatch.chdir(tmp_path)
    vertices = BALL.vertices.copy()
    vertices[100] *= -1.5  # through the other side
    ring = BALL.faces[(BALL.faces == 100).any(axis=1)]
    expected = surface_faults(Mesh(vertices, BALL.faces))
    assert expected["crossing_faces"] > 0 and expected["spikes"] > 0
    lines = [(face[0], face[1], face[1]) for face in ring]
    save_mesh(tmp_path / "ball.ply", Mesh(vertices, [*BALL.faces, *ring[:, ::-1], *lines]))
    words = ["denoise", "ball.ply", "-o", "out.ply", "--on-bad", "isolate", "--strength", "0", "--json", "--force"]
    assert run(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert {name: told[name] for name in expected} == {n: {"before": k, "after": k} for n, k in expected.items()}
    assert cn.inspect("ball.ply").crossing_faces.count == expected["crossing_faces"]


def test_spikes_and_folds_of_a_mesh_with_back_faces_are_those_of_its_front():
    front = noisy(BALL, 0.7)
    both = Mesh(front.vertices, [*front.faces, *front.faces[:, ::-1]])
    found, expected = cn.inspect(both), cn.inspect(front)
    assert expected.spikes.count > 0 and expected.folded_edges > 0
    assert (found.spikes, found.folded_edges) == (expected.spikes, expected.folded_edges)
    faults = surface_faults(both)
    assert (faults["spikes"], faults["folded_edges"]) == (expected.spikes.count, expected.folded_edges)
