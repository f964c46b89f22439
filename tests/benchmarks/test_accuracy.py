"""The accuracy benchmarks measure what their tables say."""

import json
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from shapes import grid, icosphere, noisy

from benchmarks import results, running
from benchmarks.accuracy import clean, kinds, packaged_models, pairs, scans
from cascadenorm.geometry.nearest import SurfaceTree
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh

EXAMPLES = Path(__file__).parents[2] / "cascadenorm" / "demo_data"
UP = np.array([0.0, 0, 1])


def rows_of(text: str) -> dict[str, list[str]]:
    """Return the cells of each row of the Markdown tables in a text, without bold face, by the first cell."""
    lines = [line.replace("**", "").strip("| ").split(" | ") for line in text.splitlines() if line.startswith("|")]
    return {first: cells for first, *cells in lines}


def tilted(mesh: Mesh, degrees: float) -> Mesh:
    """Rotate a mesh about the x axis."""
    angle = np.radians(degrees)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    return mesh.moved(mesh.vertices @ turn.T)


def test_methods_are_named_with_their_parameters():
    assert running.parsed("auto") == ("auto", {})
    assert running.parsed("x.safetensors") == ("auto", {"model": Path("x.safetensors")})
    mesh = noisy(icosphere(2), 0.2)
    once, twice = (running.denoised(mesh, f"laplacian:iterations={count}").vertices for count in (1, 2))
    again = running.denoised(mesh.moved(once), "laplacian:iterations=1").vertices
    assert not np.allclose(once, twice)
    np.testing.assert_allclose(again, twice, atol=1e-9)


def test_pairs_are_measured_and_shown(capsys):
    pairs.main([str(EXAMPLES / "scan"), "--method", "bilateral-normal"])
    printed = capsys.readouterr().out
    noisy_error, error = rows_of(printed)["scan"]
    assert f"**{error}**" in printed and float(error) < float(noisy_error)
    assert rows_of(printed)["mean angle of normals, degrees"] == [noisy_error, error]


def test_other_programs_are_columns_of_the_table_of_pairs(tmp_path, capsys):
    errors = {"Ev": 0.125, "flip": 0.5}
    runs = {"bnf tuned": {"Ea_deg": 9.75, **errors}, "gnf tuned": {"Ea_deg": 9.25, **errors}}
    runs |= {"l0 default": {"Ea_deg": 0.5, **errors}, "published": {"Ea_deg": 8.25, **errors}}
    assert pairs.other_programs(runs) == {pairs.TUNED: (9.25, 0.125, 0.5), pairs.PUBLISHED: (8.25, 0.125, 0.5)}
    for name in ("scan", pairs.STEERED):
        shutil.copytree(EXAMPLES / "scan", tmp_path / "pairs" / name)
    reference = tmp_path / "results.json"
    reference.write_text(json.dumps({"scan": {"bnf tuned": runs["bnf tuned"]}, pairs.STEERED: runs}))
    pairs.main([str(tmp_path / "pairs"), "--method", "bilateral-normal", "--reference", str(reference)])
    printed = capsys.readouterr().out
    rows = rows_of(printed)
    assert rows["scan"][2:] == ["9.75", "–"] and rows[pairs.STEERED][2:] == ["9.25", "8.25"]
    assert rows["mean angle of normals without kinect_cone, degrees"] == rows["scan"]
    assert "so the means leave it out" in printed


def test_a_tilted_sheet_has_changed_by_its_angle():
    flat = grid(6, 6)
    assert clean.change(flat, flat) == (0, 0, 0, 0, 0, 0)
    after = clean.change(flat, tilted(flat, 10))
    assert after.angle == pytest.approx(10) and after.flipped == after.crossing == 0
    expected = np.linalg.norm(tilted(flat, 10).vertices - flat.vertices, axis=1)
    assert after.largest == pytest.approx(100 * expected.max() / flat.diagonal)
    assert after.rms == pytest.approx(np.sqrt(np.mean(expected**2)) / flat.mean_edge_length)
    over = clean.change(flat, tilted(flat, 170))
    assert over.flipped == len(flat.faces) and not over.is_small


def test_only_faces_that_did_not_intersect_before_are_counted():
    flat = grid(4, 4)
    two = np.concatenate([flat.vertices, flat.vertices + UP])
    apart = Mesh(two, np.concatenate([flat.faces, flat.faces + len(flat.vertices)]))
    upper = np.arange(len(two)) >= len(flat.vertices)
    steep = tilted(flat, 60).vertices - 2 * UP
    crossed = apart.moved(np.where(upper[:, None], np.concatenate([steep, steep]), two))
    assert clean.change(apart, crossed).crossing > 0
    assert clean.change(crossed, crossed).crossing == 0


def test_clean_meshes_of_pairs_count_once_and_noise_has_its_level(tmp_path, capsys):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        save_mesh(tmp_path / name / "clean.ply", icosphere(3))
        save_mesh(tmp_path / name / "noisy.ply", noisy(icosphere(3), 0.2))
    assert [name for name, _ in clean.clean_meshes(tmp_path)] == ["a"]
    clean.main([str(tmp_path), "--noise", "0", "0.1", "--method", "laplacian:iterations=0"])
    rows = rows_of(capsys.readouterr().out)
    assert rows["0"] == ["0.00 (0.00)", "0.00 (0.00)"]
    assert rows["0.1"][0] == rows["0.1"][1] != "0.00 (0.00)"


def test_clean_files_have_a_row_each_and_a_mean(tmp_path, capsys):
    for name, mesh in (("ball", icosphere(2)), ("sheet", grid(5, 5))):
        save_mesh(tmp_path / f"{name}.ply", mesh)
    clean.main([str(tmp_path), "--method", "laplacian:iterations=0"])
    printed = capsys.readouterr().out
    rows = rows_of(printed)
    assert rows["ball.ply"][2] == rows["sheet.ply"][2] == rows["mean"][2] == "0.00"
    assert "`laplacian:iterations=0`: 2 of 2 within" in printed


def test_models_of_a_package_are_found_in_its_archive_and_counted_by_package(tmp_path, capsys):
    with zipfile.ZipFile(tmp_path / "some-1.whl", "w") as wheel:
        wheel.writestr("some/ball.OBJ", "a mesh")
        wheel.writestr("some/code.py", "no mesh")
    assert list(packaged_models.mesh_files(tmp_path / "some-1.whl")) == [("some/ball.OBJ", b"a mesh")]
    for package, mesh in (("first", icosphere(3)), ("second", noisy(icosphere(3), 0.2))):
        (tmp_path / "models" / package).mkdir(parents=True)
        save_mesh(tmp_path / "models" / package / "ball.ply", mesh)
    packaged_models.main([str(tmp_path / "models")])
    rows = rows_of(capsys.readouterr().out)
    assert rows["first"] == ["1", "0.00", "0", "0"]
    assert rows["second"][2:] == rows["all"][2:] == ["1", "0"]


def scan_truth(mesh: Mesh, **changes) -> dict[str, np.ndarray]:
    """Return the truth of a sheet that the other scans saw as the plane z = 0."""
    count = len(mesh.faces)
    flat = {
        "rows": np.arange(count), "R": np.eye(3), "t": np.zeros(3), "middles": mesh.centroids, "size": np.ones(count),
        "axes": np.broadcast_to(np.eye(3), (count, 3, 3)), "coefs": np.zeros((count, 5)), "halves": np.zeros(count),
        "raw": np.broadcast_to([0.0, 0, 1], (count, 3)), "scatter": np.zeros(count),
    }  # fmt: skip
    return flat | changes


def test_scans_are_measured_by_the_fit_and_by_the_raw_normals():
    flat = grid(6, 6)
    five = tilted(flat, 5)
    chord = np.degrees(2 * np.sin(np.radians(2.5)))
    assert scans.angles(flat, scan_truth(flat)) == pytest.approx([0, 0, 0])
    assert scans.angles(five, scan_truth(flat)) == pytest.approx([5, chord, chord])
    scatter = np.full(len(flat.faces), 0.02)
    above = np.degrees(np.sqrt(np.radians(scans.angles(tilted(flat, 20), scan_truth(flat))[1]) ** 2 - 0.02))
    assert scans.angles(tilted(flat, 20), scan_truth(flat, scatter=scatter))[1] == pytest.approx(above)
    assert scans.angles(five, scan_truth(flat, scatter=scatter))[1] == 0  # less than the scatter


def test_scans_are_placed_in_the_frame_of_the_truth():
    flat = grid(6, 6)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = flat.moved((flat.vertices - [[1, 2, 3]]) @ turn)
    assert scans.angles(moved, scan_truth(flat, R=turn, t=np.array([1, 2, 3]))) == pytest.approx([0, 0, 0], abs=1e-5)


def test_a_curved_fit_has_the_normals_of_its_graph():
    flat = grid(6, 6)
    coefs = np.tile([0.1, -0.2, 0.03, 0.02, -0.01], (len(flat.faces), 1))
    origin = np.tile([3.0, 3, 0], (len(flat.faces), 1))
    truth = scan_truth(flat, coefs=coefs, middles=origin, size=np.full(len(flat.faces), 2.0))
    u, v = ((flat.centroids - origin)[:, :2] / 2).T
    slope_u, slope_v = 0.1 + 0.06 * u + 0.02 * v, -0.2 + 0.02 * u - 0.02 * v
    normals = np.stack([-slope_u, -slope_v, np.ones_like(u)], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(scans.fitted_normals(flat.centroids, truth), normals, atol=1e-12)


def test_faces_that_the_other_scans_do_not_agree_on_are_not_judged():
    flat = grid(6, 6)
    unsure = np.where(np.arange(len(flat.faces)) < 10, 20.0, 0.0)
    raw = np.where(unsure[:, None] > 0, [1.0, 0, 0], [0.0, 0, 1])
    assert scans.angles(flat, scan_truth(flat, halves=unsure, raw=raw)) == pytest.approx([0, 0, 0])
    unseen = np.where(unsure > 0, np.nan, 0.0)
    assert scans.angles(flat, scan_truth(flat, scatter=unseen, raw=raw)) == pytest.approx([0, 0, 0])
    wrong = np.where(np.arange(len(flat.faces)) < 0.04 * len(flat.faces), 1.0, 0.0)[:, None] * [1.0, 0, -1]
    _, fair, fair95 = scans.angles(flat, scan_truth(flat, raw=np.array([0.0, 0, 1]) + wrong))
    assert fair > 10 and fair95 == 0


def test_a_folder_of_scans_is_measured(tmp_path, capsys):
    flat = grid(6, 6)
    (tmp_path / "one").mkdir()
    save_mesh(tmp_path / "one" / "noisy.ply", tilted(flat, 5))
    np.savez(tmp_path / "one" / "truth.npz", **scan_truth(flat))
    scans.main([str(tmp_path), "--method", "laplacian:iterations=0"])
    rows = rows_of(capsys.readouterr().out)
    assert rows["noisy"] == rows["laplacian:iterations=0"] == ["5.00", "5.00", "5.00"]


def test_errors_of_a_kind_are_angles_and_distances_to_the_true_surface():
    flat = grid(6, 6)
    truth = kinds.Truth(flat, SurfaceTree(flat))
    assert kinds.errors(flat, truth, edge=1.0) == pytest.approx((0, 0))
    raised = flat.moved(flat.vertices + 0.1 * UP)
    assert kinds.errors(raised, truth, edge=0.5) == pytest.approx((0, 0.2))


def test_filters_of_other_libraries_have_a_row_at_their_defaults_and_one_tuned():
    name = next(iter(kinds.FILTERS))
    cases = {
        "seg-a": {"noisy": [(20.0, 0.2)], name: [(9.0, 0.3), (5.0, 0.1), None]},
        "seg-b": {"noisy": [(10.0, 0.4)], name: [None, (7.0, 0.3), None]},
        "ct-a": {"noisy": [(8.0, 0.1)], name: [None, None, None]},
    }
    figures = json.loads(json.dumps(kinds.figures_of(cases)))
    assert rows_of(kinds.peer_table(figures)) == {
        kinds.HEADING: ["ct", "seg"],
        "---": ["---:", "---:"],
        "noisy": ["8.0 (0.100)", "15.0 (0.300)"],
        f"{name}, defaults": ["fails", "9.0 (0.300)"],
        f"{name}, oracle-tuned": ["fails", "6.0 (0.200)"],
    }
    assert rows_of(kinds.table(figures))["seg (2)"] == ["15.0 (0.300)", "9.0 (0.300)", "6.0 (0.200)"]


def test_new_figures_of_a_method_are_those_beside_other_libraries(tmp_path):
    (tmp_path / results.FOLDER).mkdir(parents=True)
    page = tmp_path / results.PAGES[kinds.PEERS][0]
    page.write_text("<!-- peers: x -->\n<!-- end of peers -->\n")
    other = {"auto": {"seg": [9.0, 0.2]}, "Open3D Taubin, defaults": {"seg": [8.0, 0.3]}}
    results.write(kinds.PEERS, {"kinds": {"seg": 2}, "means": other}, root=tmp_path)
    figures = {"kinds": {"seg": 1}, "means": {"auto": {"seg": [3.0, 0.1]}, "cascade": {"seg": [4.0, 0.1]}}}
    kinds.renew_peers(figures, root=tmp_path)
    assert results.read(kinds.PEERS, root=tmp_path)["means"] == other  # measured on other cases
    kinds.renew_peers({**figures, "kinds": {"seg": 2}}, root=tmp_path)
    renewed = results.read(kinds.PEERS, root=tmp_path)["means"]
    assert renewed == other | {"auto": {"seg": [3.0, 0.1]}}
    assert "| auto | 3.0 (0.100) |" in page.read_text()


def test_cases_are_found_by_kind_and_shape(tmp_path, capsys):
    for case in ("seg-ball", "ct-ball"):
        (tmp_path / "cases" / case).mkdir(parents=True)
        save_mesh(tmp_path / "cases" / case / "noisy.ply", noisy(icosphere(2), 0.2))
    save_mesh(tmp_path / "ball.ply", icosphere(2))
    arguments = [str(tmp_path / "cases"), "--truth", str(tmp_path / "{shape}.ply"), "--kind", "seg"]
    kinds.main([*arguments, "--method", "laplacian:iterations=0"])
    printed = rows_of(capsys.readouterr().out)
    assert "ct (1)" not in printed
    noisy_cell, denoised = printed["seg (1)"]
    assert noisy_cell == denoised and float(noisy_cell.split()[0]) > 5
