"""What commands write and print, as text and as JSON."""

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from commands import CLEAN, FAST, ROUGH, command, refused
from partitions import walls
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.registry.controls import CONTROLS


def test_denoise_writes_beside_its_input_and_says_so(place, capsys):
    before = (place / "ball.ply").read_bytes()
    assert run(["denoise", "ball.ply", *FAST]) == 0
    out, err = capsys.readouterr()
    assert "ball.ply -> ball_denoised.ply" in out and "162 of 162 vertices moved" in out and err == ""
    assert (place / "ball.ply").read_bytes() == before
    mesh = cn.read(place / "ball_denoised.ply").mesh
    np.testing.assert_array_equal(mesh.vertices, cn.denoise(ROUGH, method="laplacian").vertices)
    np.testing.assert_array_equal(mesh.faces, ROUGH.faces)


def test_a_mesh_without_error_comes_back_unchanged_and_what_removes_more_is_named(place, capsys):
    save_mesh(Path("cube.ply"), cube(6))
    assert run(["denoise", "cube.ply", "-o", "out.ply", "--report", "cube.html"]) == 0
    out, err = capsys.readouterr()
    assert "0 of 218 vertices moved" in out and "kind of error: no significant error" in out
    said = "auto found no error and moved no vertex; a strength above 1, the removal of detail or another method"
    assert said in err and said in Path("cube.html").read_text(encoding="utf-8")
    np.testing.assert_array_equal(cn.read("out.ply").mesh.vertices, cn.read("cube.ply").mesh.vertices)
    assert run(["denoise", "cube.ply", "-o", "fixed.ply", "--strength", "0"]) == 0
    assert "moved no vertex" not in capsys.readouterr().err


def test_the_setting_for_remeshed_scans_is_named_if_auto_finds_no_error(place, capsys):
    save_mesh(Path("smooth.ply"), icosphere(3))
    assert run(["denoise", "smooth.ply", "-o", "out.ply"]) == 0
    said = "if the mesh was remeshed after a scan or a segmentation, set treat_as=measured-surface"
    assert said in capsys.readouterr().err
    assert run(["denoise", "smooth.ply", "-o", "set.ply", "--set", "treat_as=vertex-noise"]) == 0
    assert said not in capsys.readouterr().err


def test_options_reach_the_method_and_its_controls(place):
    options = ["--set", "iterations=2", "--set", "step=0.3", "--strength", "1.5", "--keep-volume", "--threads", "1"]
    assert run(["denoise", "ball.ply", "-o", "out.ply", *FAST, *options, "--max-displacement", "0.3 edges"]) == 0
    expected = cn.denoise(
        ROUGH, method="laplacian", iterations=2, step=0.3, strength=1.5, volume="keep", max_displacement="0.3 edges"
    )
    np.testing.assert_array_equal(cn.read("out.ply").mesh.vertices, expected.vertices)


def test_boundaries_and_detail_reach_the_controls(place, capsys):
    sheet = noisy(grid(4, 4), 0.1)
    save_mesh(place / "sheet.ply", sheet)
    options = ["--boundary", "smooth", "--keep-detail", "2 edges"]
    assert run(["denoise", "sheet.ply", "-o", "out.ply", *FAST, *options]) == 0
    expected = cn.denoise(sheet, method="laplacian", boundary="smooth", keep_detail="2 edges").vertices
    np.testing.assert_array_equal(cn.read("out.ply").mesh.vertices, expected)
    capsys.readouterr()
    code, message = refused(capsys, "denoise", "sheet.ply", *FAST, "--boundary", "open")
    assert code == 2 and "must be one of free, smooth, fixed" in message


def test_regions_and_creases_are_said_in_words(place, capsys):
    corners = "\n".join(f"{a} {b} 0" for a, b in ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (2, 1)))
    faces = "usemtl a\nf 1 2 3\nf 2 4 3\nusemtl b\nf 2 5 4\nf 5 6 4\n"
    (place / "two.obj").write_text("v " + corners.replace("\n", "\nv ") + "\n" + faces)
    np.save(place / "mask.npy", np.ones(6))
    words = ["--mask", "mask.npy", "--fixed", "0", "--only", "a", "--only", "b", "--creases", "80"]
    assert run(["denoise", "two.obj", "-o", "out.obj", *FAST, *words]) == 0
    mesh = cn.read("two.obj").mesh
    expected = cn.denoise(mesh, method="laplacian", fixed=[0]).vertices
    np.testing.assert_allclose(cn.read("out.obj").mesh.vertices, expected, atol=1e-12)
    capsys.readouterr()
    code, message = refused(capsys, "denoise", "two.obj", *FAST, "--only", "c")
    assert code == 2 and "--only matches no face with 'c'; there are: material=a, material=b" in message


def test_json_says_what_was_done(place, capsys):
    assert run(["denoise", "ball.ply", "-o", "out.obj", *FAST, "--set", "iterations=2", "--json"]) == 0
    out, _ = capsys.readouterr()
    done = json.loads(out)
    assert (done["version"], done["command"], done["output"]) == (1, "denoise", "out.obj")
    assert (done["vertices"], done["faces"], done["moved"]) == (162, 320, 162)
    assert done["parameters"] == {"iterations": "2"}
    moves = np.linalg.norm(cn.denoise(ROUGH, method="laplacian", iterations=2).vertices - ROUGH.vertices, axis=1)
    assert done["largest_displacement"] == pytest.approx(moves.max() / ROUGH.mean_edge_length)
    assert done["mean_displacement"] == pytest.approx(moves.mean() / ROUGH.mean_edge_length)


NO_CONTROLS = {
    **dict.fromkeys(
        ("mask", "fixed", "only", "creases", "keep_detail", "remove_detail", "max_displacement", "volume", "slide")
    ),
    "boundary": "free",
    "on_bad": "error",
}


def test_json_says_which_controls_were_in_force(place, capsys):
    vertices = "v 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 1 1 0 1 1 1\nv 0 1 0 1 1 1\n"
    (place / "two.obj").write_text(f"{vertices}usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n", encoding="ascii")
    words = {
        "--mask": "red",
        "--fixed": "0,2-3",
        "--only": "material=a",
        "--boundary": "smooth",
        "--creases": "40",
        "--keep-detail": "4 edges",
        "--remove-detail": "1 edge",
        "--max-displacement": "0.5 edges",
        "--on-bad": "isolate",
    }
    expected = {option[2:].replace("-", "_"): value for option, value in words.items()}
    expected |= {"only": ["material=a"], "slide": None}
    given = [word for pair in words.items() for word in pair]
    assert run(["denoise", "two.obj", *FAST, *given, "--keep-volume", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["controls"] == {**expected, "volume": "keep"}
    assert run(["denoise", "ball.ply", *FAST, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["controls"] == NO_CONTROLS
    assert set(NO_CONTROLS) == set(CONTROLS) - {"strength", "threads", "progress", "halo"}


BALL = icosphere(2)
MIXED = [face[:: 1 if number % 3 else -1] for number, face in enumerate(BALL.faces)]


@pytest.mark.parametrize(
    ("mesh", "is_open"),
    [
        pytest.param(Mesh(BALL.vertices, BALL.faces[1:]), True, id="open"),
        pytest.param(BALL, False, id="closed"),
        pytest.param(Mesh(BALL.vertices, MIXED), False, id="every third face flipped"),
        pytest.param(Mesh(BALL.vertices, [*BALL.faces, BALL.faces[0]]), False, id="a face twice"),
        pytest.param(Mesh(BALL.vertices, [*BALL.faces, (0, 0, 1)]), False, id="a face that repeats a vertex"),
        pytest.param(walls("half balls", voxel=0.3).mesh, False, id="regions that share a wall"),
    ],
)
def test_a_volume_that_cannot_be_kept_is_named(place, capsys, mesh, is_open):
    save_mesh(place / "kept.ply", mesh)
    assert run(["denoise", "kept.ply", "-o", "out.ply", *FAST, "--keep-volume"]) == 0
    said = "cascadenorm: the volume was not kept: no component of the mesh is closed\n"
    assert "volume" not in (err := capsys.readouterr().err).replace(said, "") and (said in err) == is_open
    assert run(["denoise", "kept.ply", "-o", "same.ply", *FAST, "--keep-volume", "--strength", "0"]) == 0
    assert "volume" not in capsys.readouterr().err


def test_vertices_that_nearly_coincide_are_named_and_how_to_join_them_if_the_command_can(place, capsys):
    sheet = grid(6, 6)
    right = sheet.centroids[:, 0] > 3
    vertices = np.concatenate([sheet.vertices, sheet.vertices + 1e-5])
    save_mesh(place / "seam.ply", Mesh(vertices, np.where(right[:, None], sheet.faces + 49, sheet.faces)))
    said = "7 boundary vertices lie within 0.001 edges of another one, but not joined with it"
    assert run(["denoise", "seam.ply", *FAST]) == 0
    assert f"{said}: --weld '0.001 edges' joins them\n" in capsys.readouterr().err
    assert run(["denoise-regions", "seam.ply", *FAST, "--force"]) == 0
    assert f"{said}\n" in capsys.readouterr().err


def test_a_volume_that_a_limit_does_not_let_restore_is_named(place, capsys):
    vertices, faces = np.concatenate([ROUGH.vertices, ROUGH.vertices + 5]), [*ROUGH.faces, *(ROUGH.faces + 162)]
    save_mesh(place / "two.ply", Mesh(vertices, faces))
    words = ["denoise", "two.ply", *FAST, "--keep-volume", "--fixed", "162-323", "--force"]
    for limit, changed in ((), 0), (("--max-displacement", "0.1 edges"), 1):
        assert run([*words, *limit, "--report", "two.html"]) == 0
        said = "the volume of 1 of 2 closed surfaces was not kept: fixed vertices or the limit of"
        assert (said in capsys.readouterr().err) == (said in Path("two.html").read_text("utf-8")) == bool(changed)
        assert run([*words, *limit, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert (told["closed_surfaces"], told["changed_volumes"]) == (2, changed)


def test_the_controls_in_force_are_printed(place, capsys):
    assert run(["denoise", "ball.ply", "-o", "a.ply", *FAST, "--strength", "0.5", "--keep-detail", "4 edges"]) == 0
    assert "controls: strength 0.5, keep-detail 4 edges\n" in capsys.readouterr().out
    assert run(["denoise", "ball.ply", "-o", "strong.ply", *FAST, "--strength", "2"]) == 0
    assert "controls: strength 2\n" in capsys.readouterr().out
    assert run(["denoise", "ball.ply", "-o", "b.ply", *FAST]) == 0
    assert "controls" not in capsys.readouterr().out
    done = cn.denoise_file("ball.ply", "c.ply", method="laplacian", mask=np.ones(162), creases=40.0)
    assert done.controls == {**NO_CONTROLS, "mask": "array of shape (162,)", "creases": 40.0}


def test_another_extension_converts_and_no_strength_copies(place):
    assert run(["denoise", "ball.ply", "-o", "same.ply", *FAST, "--strength", "0"]) == 0
    assert (place / "same.ply").read_bytes() == (place / "ball.ply").read_bytes()
    assert run(["denoise", "ball.ply", "-o", "out.off", *FAST, "--strength", "0"]) == 0
    assert (place / "out.off").read_bytes().startswith(b"OFF")


def test_nothing_is_overwritten_without_force(place, capsys):
    (place / "ball_denoised.ply").write_text("precious")
    code, message = refused(capsys, "denoise", "ball.ply", *FAST)
    assert code == 5 and "ball_denoised.ply exists already" in message and "--force" in message
    assert (place / "ball_denoised.ply").read_text() == "precious"
    assert run(["denoise", "ball.ply", *FAST, "--force"]) == 0
    assert len(cn.read("ball_denoised.ply").mesh.faces) == 320
    assert sorted(path.name for path in place.iterdir()) == ["ball.ply", "ball_denoised.ply", "true.ply"]


def test_streams(place):
    data = (place / "ball.ply").read_bytes()
    done = command("denoise", "-", *FAST, "--json", stdin=data)
    assert done.returncode == 0
    report = json.loads(done.stderr)
    assert (report["source"], report["output"]) == ("<stdin>", "<stdout>")
    expected = cn.denoise(ROUGH, method="laplacian").vertices
    np.testing.assert_array_equal(cn.read(io.BytesIO(done.stdout)).mesh.vertices, expected)


def test_no_message_follows_a_mesh_on_the_device_of_standard_output(place):
    by_name = command("denoise", "ball.ply", *FAST, "-o", "/dev/stdout")
    assert by_name.stdout == command("denoise", "ball.ply", *FAST, "-o", "-").stdout != b""


def test_a_stream_has_the_format_that_is_asked_for(place):
    data = (place / "ball.ply").read_bytes()
    done = command("denoise", "-", *FAST, "--format", "off", stdin=data)
    assert done.returncode == 0 and done.stdout.startswith(b"OFF")
    expected = cn.denoise(ROUGH, method="laplacian").vertices
    np.testing.assert_array_equal(cn.read(io.BytesIO(done.stdout)).mesh.vertices, expected)
    done = command("denoise", "-", *FAST, "--format", "doc", stdin=data)
    assert done.returncode == 5 and done.stdout == b"" and b"'doc' cannot be written" in done.stderr
    done = command("denoise", "ball.ply", *FAST, "--format", "off")
    assert done.returncode == 2 and b"--format applies to stdout only" in done.stderr


def test_a_report_is_named_when_it_is_written(place, capsys):
    pytest.importorskip("PIL")
    assert run(["denoise", "ball.ply", *FAST, "--report", "report.html"]) == 0
    assert "report: report.html\n" in capsys.readouterr().out
    assert run(["inspect", "ball.ply", "--report", "inspected.html"]) == 0
    assert "report: inspected.html\n" in capsys.readouterr().out


def test_compare_prints_the_measures(place, capsys):
    assert run(["compare", "ball.ply", "true.ply", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = cn.compare(ROUGH, CLEAN)
    assert found["command"] == "compare"
    assert found["measures"]["normal_error_deg"] == expected.normal_error_deg
    assert found["measures"]["volume_ratio"] == pytest.approx(expected.volume_ratio)
    assert run(["compare", "ball.ply", "true.ply"]) == 0
    (row,) = [line for line in capsys.readouterr().out.splitlines() if "mean angle E_a (°)" in line]
    assert f" {expected.normal_error_deg:.3f} " in row


@pytest.fixture
def pairs(tmp_path) -> Path:
    for name, clean in {"ball": CLEAN, "sheet": grid(6, 6)}.items():
        (tmp_path / "pairs" / name).mkdir(parents=True)
        save_mesh(tmp_path / "pairs" / name / "noisy.ply", noisy(clean, 0.2))
        save_mesh(tmp_path / "pairs" / name / "clean.ply", clean)
    return tmp_path / "pairs"


def test_evaluate_prints_a_table_json_and_csv(pairs, tmp_path, capsys):
    table = tmp_path / "table.csv"
    assert run(["evaluate", str(pairs), *FAST, "--csv", str(table), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = cn.evaluate([pairs], methods=["laplacian"])
    errors = [result.measures.normal_error_deg for result in expected.results]
    assert [row["normal_error_deg"] for row in found["results"]] == errors
    assert [(row["pair"], row["method"]) for row in found["means"]] == [("mean", "noisy"), ("mean", "laplacian")]
    assert found["failures"] == []
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["normal_error_deg"]) for row in rows] == errors
    assert rows[0]["volume_ratio"] and rows[2]["volume_ratio"] == ""  # a sheet encloses nothing
    assert refused(capsys, "evaluate", str(pairs), *FAST, "--csv", str(table))[0] == 5
    assert run(["evaluate", str(pairs), *FAST, "--csv", str(tmp_path / "no" / "table.csv")]) == 5
    capsys.readouterr()
    (tmp_path / "marked" / "[final]").mkdir(parents=True)
    for half in ("noisy.ply", "clean.ply"):
        (tmp_path / "marked" / "[final]" / half).write_bytes((pairs / "ball" / half).read_bytes())
    assert run(["evaluate", str(tmp_path / "marked"), *FAST]) == 0
    assert "[final]" in capsys.readouterr().out
    header = table.read_text().split("\n")[0]
    (tmp_path / "bad" / "one").mkdir(parents=True)
    for name in ("noisy.ply", "clean.ply"):
        (tmp_path / "bad" / "one" / name).write_bytes(b"")
    assert run(["evaluate", str(tmp_path / "bad"), *FAST, "--csv", str(tmp_path / "none.csv")]) == 6
    assert (tmp_path / "none.csv").read_text() == f"{header}\n"
    capsys.readouterr()

    assert run(["evaluate", str(pairs / "sheet"), *FAST]) == 0
    out = capsys.readouterr().out
    assert f"{errors[3]:.2f}" in out and "open" in out and "mean" in out


@pytest.mark.parametrize(
    "line",
    ["evaluate pairs --csv same.md --markdown ./same.md", "render pairs/ball/clean.ply -o a.webp --turntable a.webp"],
)
def test_two_outputs_that_are_the_same_file_are_refused(line, pairs, monkeypatch, capsys):
    monkeypatch.chdir(pairs.parent)
    code, message = refused(capsys, *line.split())
    assert code == 5 and "several outputs are the same file" in message
    assert [path.name for path in pairs.parent.iterdir()] == ["pairs"]


def test_a_bad_pair_is_exit_code_6_and_the_rest_is_shown(pairs, capsys):
    (pairs / "ball" / "noisy.ply").write_bytes(b"")
    assert run(["evaluate", str(pairs), *FAST, "--json"]) == 6
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert [row["pair"] for row in found["results"]] == ["sheet", "sheet"]
    assert found["failures"][0]["pair"] == "ball" and "empty" in found["failures"][0]["message"]
    assert err.count("\n") == 1 and "noisy.ply: the file is empty" in err


def test_evaluate_takes_results_of_other_programs(pairs, tmp_path, capsys):
    (tmp_path / "theirs").mkdir()
    save_mesh(tmp_path / "theirs" / "ball.ply", CLEAN)
    save_mesh(tmp_path / "theirs" / "sheet.ply", grid(3, 3))
    given = ["--result", f"theirs={tmp_path / 'theirs'}"]
    assert run(["evaluate", str(pairs), *FAST, *given, "--json"]) == 0
    out, err = capsys.readouterr()
    rows = [row for row in json.loads(out)["results"] if row["method"] == "theirs"]
    assert rows[0]["normal_error_deg"] == pytest.approx(0, abs=1e-4) and rows[0]["same_faces"]
    assert not rows[1]["same_faces"] and "sheet, theirs: faces differ from clean.*" in err
    (tmp_path / "theirs" / "ball.ply").unlink()
    assert run(["evaluate", str(pairs), *FAST, *given]) == 6
    out, err = capsys.readouterr()
    assert "theirs" in out and "holds no mesh ball.*" in err
    assert refused(capsys, "evaluate", str(pairs), "--result", "theirs")[0] == 2
    assert "theirs: the name is given twice" in refused(capsys, "evaluate", str(pairs), *given, *given)[1]
    assert refused(capsys, "evaluate", str(pairs), "--result", f"theirs={tmp_path / 'absent'}")[0] == 3


def test_spectrum_prints_eigenvalues_and_the_distance_of_two(place, capsys):
    assert run(["spectrum", "ball.ply", "true.ply", "-n", "5", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = cn.spectrum(ROUGH, CLEAN, count=5)
    assert (found["command"], found["mesh"], found["other"], found["scale"]) == (
        "spectrum",
        "ball.ply",
        "true.ply",
        "area",
    )
    assert found["eigenvalues"] == pytest.approx(expected.values, abs=1e-6)
    assert found["other_eigenvalues"] == pytest.approx(expected.other, abs=1e-6)
    assert found["distance"] == pytest.approx(expected.distance)
    assert run(["spectrum", "ball.ply", "-n", "5", "--scale", "keep"]) == 0
    out = capsys.readouterr().out
    (fifth,) = re.findall(r"│ 5 │ +([\d.]+)", out)
    assert float(fifth) == pytest.approx(cn.spectrum(ROUGH, count=5, scale="keep").values[4], rel=1e-4)
    assert "distance" not in out
    assert run(["spectrum", "ball.ply", "true.ply", "-n", "5"]) == 0
    assert "distance: " in capsys.readouterr().out
    assert refused(capsys, "spectrum", "absent.ply")[0] == 3
    code, message = refused(capsys, "spectrum", "ball.ply", "-n", "100000")
    assert code == 2 and "ask for 1 to" in message
    assert refused(capsys, "spectrum", "ball.ply", "--scale", "size")[0] == 2


def test_methods_lists_every_method_and_its_parameters(capsys):
    assert run(["methods", "--json"]) == 0
    found = {method["name"]: method for method in json.loads(capsys.readouterr().out)["methods"]}
    assert set(found) == set(cn.methods())
    names = {parameter["name"] for parameter in found["laplacian"]["parameters"]}
    assert names == set(cn.methods()["laplacian"].settings) - {"region"}
    assert run(["methods"]) == 0
    assert all(name in capsys.readouterr().out for name in ["laplacian"])
    assert run(["methods", "bilateral-normal"]) == 0
    out = capsys.readouterr().out
    assert "Zheng" in out and "sigma_r" in out and "mean edge lengths" in out


def test_generate_makes_pairs_that_evaluate_reads(tmp_path, capsys):
    folder = str(tmp_path / "set")
    assert run(["generate", folder, "--count", "1", "--seed", "3"]) == 0
    assert "1 pair in" in capsys.readouterr().out
    assert run(["evaluate", folder, *FAST, "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["results"]) == 2
    code, message = refused(capsys, "generate", folder, "--count", "1")
    assert code == 5 and "is not empty" in message


def test_render_draws_meshes_side_by_side(place, capsys):
    assert run(["render", "ball.ply", "true.ply", "-o", "both.png", "--size", "40"]) == 0
    assert capsys.readouterr().out == "both.png\n"
    data = (place / "both.png").read_bytes()
    assert data.startswith(b"\x89PNG") and int.from_bytes(data[16:20], "big") >= 80
    assert refused(capsys, "render", "ball.ply", "-o", "both.png")[0] == 5
    assert (place / "both.png").read_bytes() == data
    assert refused(capsys, "render", "absent.ply", "-o", "new.png")[0] == 3
