import csv
import io
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shapes import grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.cli.options import OTHER_OPTIONS
from cascadenorm.controls import CONTROLS
from cascadenorm.io.interop import save_mesh

CLEAN = icosphere(2)
ROUGH = noisy(CLEAN, 0.2)
FAST = ["--method", "laplacian"]
OFF = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / "ball.ply", ROUGH)
    save_mesh(tmp_path / "true.ply", CLEAN)
    return tmp_path


def command(*arguments: str, stdin: bytes | None = None) -> subprocess.CompletedProcess:
    """Run the installed command in a process of its own."""
    code = "from cascadenorm.cli import main; main()"
    return subprocess.run([sys.executable, "-c", code, *arguments], input=stdin, capture_output=True)


def refused(capsys, *arguments: str) -> tuple[int, str]:
    """Exit code and message of a run that has to end in one line on stderr, and nothing else."""
    code = run(arguments)
    out, err = capsys.readouterr()
    assert out == "" and "Traceback" not in err
    assert err.startswith("cascadenorm: ") and err.count("\n") == 1
    return code, err


# outputs


@pytest.mark.parametrize(
    "arguments",
    [
        "denoise ball.ply -o new/out.ply",
        "denoise ball.ply --report new/r.html",
        "denoise ball.ply -o new/out.ply --memory 1GB",
        "inspect ball.ply --report new/r.html",
        "compare ball.ply true.ply --report new/r.html",
        "fill-holes ball.ply -o new/out.ply",
        "render ball.ply -o new/a.png",
        "render ball.ply -o a.png --turntable new/a.webp",
        "train --quick -o new/w.safetensors",
        "train --quick --log new/log.csv",
        "train-gate ball.ply ball.ply -o new/w.safetensors",
        "models --hub new/card.md",
        "evaluate . --csv new/a.csv",
        "evaluate . --markdown new/a.md",
        "evaluate . --latex new/a.tex",
        "evaluate . --html new/a.html",
    ],
)
def test_an_output_in_a_folder_that_does_not_exist_is_refused_before_any_work(place, capsys, arguments):
    if arguments.startswith("train "):
        pytest.importorskip("torch")
    before = sorted(place.rglob("*"))
    code, message = refused(capsys, *arguments.split())
    assert code == 5 and "the folder new does not exist: create it first" in message
    assert sorted(place.rglob("*")) == before


# messages


def test_arguments_are_named_as_options_and_parameters_of_methods_are_not(place, capsys):
    assert not OTHER_OPTIONS & {name for method in cn.methods().values() for name in method.settings}
    for arguments, told in (
        ("render ball.ply -o a.png --values bogus", "--values is 'bogus'; it must be one of angle, "),
        ("batch ball.ply -o out --memory much", "--memory is 'much'"),
        ("denoise ball.ply --scheduler local", "--scheduler works on patches"),
        ("denoise ball.ply --method laplacian --set iterations=-1", "iterations is -1"),
    ):
        code, message = refused(capsys, *arguments.split())
        assert code == 2 and message.startswith(f"cascadenorm: {told}")


def test_the_mesh_that_does_not_fit_the_reference_is_named(place, capsys):
    save_mesh(place / "other.ply", grid(3, 3))
    code, message = refused(
        capsys, *["render", "ball.ply", "true.ply", "-o", "a.png", "--values", "angle", "--reference", "other.ply"]
    )
    assert code == 4 and "mesh 1 does not have the same faces as the mesh that it is compared with" in message


@pytest.mark.parametrize("name", ["inspect", "compare true.ply", "render -o a.png"])
def test_a_url_is_named_as_one_by_commands_that_read_files(place, capsys, name):
    code, message = refused(capsys, *name.split(), "https://example.org/a.ply")
    assert code == 3 and message == "cascadenorm: https://example.org/a.ply is a URL: download the file first\n"


# denoise


def test_denoise_writes_beside_its_input_and_says_so(place, capsys):
    before = (place / "ball.ply").read_bytes()
    assert run(["denoise", "ball.ply", *FAST]) == 0
    out, err = capsys.readouterr()
    assert "ball.ply -> ball_denoised.ply" in out and "162 of 162 vertices moved" in out and err == ""
    assert (place / "ball.ply").read_bytes() == before
    mesh = cn.read(place / "ball_denoised.ply").mesh
    np.testing.assert_array_equal(mesh.vertices, cn.denoise(ROUGH, method="laplacian").vertices)
    np.testing.assert_array_equal(mesh.faces, ROUGH.faces)


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


# bad input

BAD_FILES = {
    "empty.ply": (b"", 3, "empty.ply: the file is empty"),
    "text.ply": (b"Dear Sir or Madam,\n", 3, "text.ply"),
    "text.xyz": (b"1 2 3\n4 5 6\n", 3, "text.xyz"),
    "random.stl": (bytes(range(256)) * 4, 3, "random.stl"),
    "index.off": (OFF.replace("3 2 0 3", "3 2 0 9").encode(), 4, "index.off: 1 face uses vertices that do not exist"),
    "nan.off": (OFF.replace("0 0 1\n", "0 0 nan\n").encode(), 4, "nan.off: 1 of 4 vertices are not finite"),
    "points.off": (b"OFF\n2 0 0\n0 0 0\n1 1 1\n", 4, "points.off: the file has 2 vertices and no faces"),
}


@pytest.mark.parametrize("name", BAD_FILES)
@pytest.mark.parametrize("words", [["denoise", *FAST], ["compare", "true.ply"]])
def test_bad_files_end_in_one_line_and_no_output(place, capsys, name, words):
    content, code, message = BAD_FILES[name]
    (place / name).write_bytes(content)
    before = sorted(place.iterdir())
    found, line = refused(capsys, *words, name)
    assert found == code and message in line
    assert sorted(place.iterdir()) == before


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
def test_truncated_files_are_unreadable(place, capsys, share):
    whole = (place / "ball.ply").read_bytes()
    (place / "cut.ply").write_bytes(whole[: int(share * len(whole))])
    assert refused(capsys, "denoise", "cut.ply", *FAST)[0] == 3


def test_missing_files_and_folders(place, capsys):
    code, message = refused(capsys, "denoise", "absent.ply", *FAST)
    assert code == 3 and "absent.ply does not exist" in message
    for command in (["denoise", *FAST], ["fill-holes"], ["denoise-regions", "-o", "out", *FAST]):
        code, message = refused(capsys, *command, "absent")
        assert code == 3 and "absent does not exist: check the name" in message
    assert refused(capsys, "denoise", ".", "-o", "out.ply", *FAST)[0] == 3
    for name in ("", ".", "..", "/"):
        for command in (("denoise", name, *FAST), ("fill-holes", name)):
            code, message = refused(capsys, *command)
            assert code == 3 and "is a folder: give the name of a mesh file in it" in message
    code, message = refused(capsys, "denoise", "ball.ply", "-o", "", *FAST)
    assert code == 5 and "is a folder" in message
    code, message = refused(capsys, "denoise", "ball.ply", "-o", "nowhere/out.ply", *FAST)
    assert code == 5 and "the folder nowhere does not exist" in message
    code, message = refused(capsys, "denoise", "ball.ply", "-o", "out.docx", *FAST)
    assert code == 5 and "'docx'" in message and "ply, obj, stl, off" in message
    assert not (place / "out.docx").exists()


@pytest.mark.parametrize("source", ["https://example.org/scan.ply", "s3://bucket/scan.ply", "scans", "scans/**/*.ply"])
def test_what_is_not_one_file_is_left_to_batch(place, capsys, source):
    (place / "scans").mkdir()
    code, message = refused(capsys, "denoise", source, "-o", "out.ply", *FAST)
    assert code == 3 and source in message and "use `cascadenorm batch`" in message
    with pytest.raises(cn.ReadError, match="denoise_files"):
        cn.denoise(source)


def test_several_files_are_left_to_batch(place, capsys):
    code, message = refused(capsys, "denoise", "ball.ply", "true.ply", *FAST)
    assert code == 2 and "true.ply" in message and "to denoise several files use `cascadenorm batch`" in message


def test_a_file_in_place_of_a_command_is_answered_with_the_command_that_denoises_it(place, capsys):
    code, message = refused(capsys, "ball.ply")
    assert code == 2 and "to denoise it, use `cascadenorm denoise ball.ply`" in message
    code, message = refused(capsys, "polish")
    assert code == 2 and "cascadenorm denoise" not in message
    assert message == "cascadenorm: No such command 'polish' (see `cascadenorm --help`)\n"


def test_a_large_strength_is_warned_of_and_does_no_more_than_ten(place, capsys):
    assert run(["denoise", "ball.ply", *FAST, "--strength", "3"]) == 0
    assert capsys.readouterr().err == ""
    for strength in ("10", "100"):
        assert run(["denoise", "ball.ply", "-o", f"{strength}.ply", *FAST, "--strength", strength]) == 0
        assert f"--strength {strength} removes shape as well as noise" in capsys.readouterr().err
    assert (place / "10.ply").read_bytes() == (place / "100.ply").read_bytes()


def test_a_report_is_named_when_it_is_written(place, capsys):
    pytest.importorskip("PIL")
    assert run(["denoise", "ball.ply", *FAST, "--report", "report.html"]) == 0
    assert "report: report.html\n" in capsys.readouterr().out
    assert run(["inspect", "ball.ply", "--report", "inspected.html"]) == 0
    assert "report: inspected.html\n" in capsys.readouterr().out


LONG = "n" * 300


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("out.docx", "the format 'docx' cannot be written"),
        ("out.xyz", "the format 'xyz' cannot be written"),
        ("out", "out has no extension"),
        ("nowhere/out.ply", "the folder nowhere does not exist"),
        ("ball.ply/out.ply", "the folder ball.ply does not exist"),
        ("true.ply", "exists already"),
        (".", ". is a folder"),
        (f"{LONG}.ply", "File name too long"),
        ("circle.ply", "link"),
        ("astray.ply", "nowhere does not exist"),
    ],
)
def test_impossible_outputs_are_refused_before_anything_is_read(place, capsys, monkeypatch, output, message):
    (place / "circle.ply").symlink_to("circle.ply")
    (place / "astray.ply").symlink_to("nowhere/out.ply")
    before = sorted(place.iterdir())
    monkeypatch.setattr("cascadenorm.api.opened_files.io.read", None)
    for command in ["denoise", "ball.ply", *FAST], ["fill-holes", "ball.ply"]:
        code, line = refused(capsys, *command, "-o", output)
        assert code == 5 and message in line
    assert sorted(place.iterdir()) == before


def test_read_only_places_are_refused_before_anything_is_read(place, capsys, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # what a read-only volume says, to root as well
    monkeypatch.setattr("cascadenorm.api.opened_files.io.read", None)
    code, line = refused(capsys, "denoise", "ball.ply", *FAST)
    assert code == 5 and "no permission to write in the folder ." in line


def test_a_file_without_extension_is_written_as_it_was_read(place):
    (place / "ball.ply").rename(place / "ball")
    assert run(["denoise", "ball", *FAST]) == 0
    assert cn.read("ball_denoised").format == "ply"
    assert run(["fill-holes", "ball"]) == run(["batch", "ball", "-o", "out", *FAST]) == 0
    assert cn.read("ball_filled").format == cn.read("out/ball").format == "ply"


def test_devices_get_the_format_that_was_read(place):
    assert run(["denoise", "ball.ply", *FAST, "-o", os.devnull]) == 0


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder(place, capsys):
    (place / "locked").mkdir(mode=0o500)
    assert refused(capsys, "denoise", "ball.ply", "-o", "locked/out.ply", *FAST)[0] == 5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["denoise", "ball.ply", "--method", "magic"], "there is no method 'magic'; there are: "),
        (["denoise", "ball.ply", *FAST, "--set", "wings=2"], "laplacian has no parameter 'wings'; it has: "),
        (["denoise", "ball.ply", *FAST, "--set", "iterations=-1"], "iterations is -1; it must be at least 0"),
        (["denoise", "ball.ply", *FAST, "--set", "iterations=many"], "iterations is 'many'; it must be a whole number"),
        (["denoise", "ball.ply", *FAST, "--set", "iterations"], "write it as NAME=VALUE"),
        (["denoise", "ball.ply", *FAST, "--set", "region=1"], "pass mask"),
        (["denoise", "ball.ply", *FAST, "--model", "x"], "laplacian has no parameter 'model'"),
        (["denoise", "ball.ply", *FAST, "--strength", "-1"], "--strength"),
        (["denoise", "ball.ply", *FAST, "--strength", "nan"], "strength"),
        (["denoise", "ball.ply", *FAST, "--strength", "two"], "--strength is 'two'; it must be a number (see"),
        (["denoise", "ball.ply", *FAST, "--threads=1.5"], "--threads is '1.5'; it must be a whole number (see"),
        (["batch", "ball.ply", "-o", "out", "--workers", "two"], "--workers is 'two'; it must be a whole number (see"),
        (
            ["render", "ball.ply"],
            "cascadenorm: there is nothing to write: give --output or --turntable (see `cascadenorm",
        ),
        (["denoise", "ball.ply", *FAST, "--threads", "0"], "--threads"),
        (["denoise", "ball.ply", *FAST, "--max-displacement", "far"], "--max-displacement is 'far'"),
        (["denoise", "ball.ply", *FAST, "--colour"], "--colour"),
        (["denoise"], "IN"),
        (["paint"], "paint"),
        (["methods", "magic"], "there is no method 'magic'"),
        (["evaluate", ".", "--method", "magic"], "there is no method 'magic'"),
    ],
)
def test_wrong_usage_is_exit_code_2(place, capsys, arguments, message):
    before = sorted(place.iterdir())
    code, line = refused(capsys, *arguments)
    assert code == 2 and message in line
    assert sorted(place.iterdir()) == before


# the other commands


def test_compare_prints_the_measures(place, capsys):
    assert run(["compare", "ball.ply", "true.ply", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = cn.compare(ROUGH, CLEAN)
    assert found["command"] == "compare"
    assert found["measures"]["normal_error_deg"] == expected.normal_error_deg
    assert found["measures"]["volume_ratio"] == pytest.approx(expected.volume_ratio)
    assert run(["compare", "ball.ply", "true.ply"]) == 0
    assert f"{expected.normal_error_deg:.3f} deg" in capsys.readouterr().out


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


# the process


def test_version_and_help(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"cascadenorm {cn.__version__}\n"
    assert run(["--help"]) == 0
    assert "denoise" in capsys.readouterr().out
    assert run([]) == 2


def test_an_interruption_that_a_library_turns_into_its_own_error_is_one(place, capsys, monkeypatch):
    def failing(*_, **__):
        raise ImportError("numpy failed to import")

    monkeypatch.setattr("cascadenorm.cli.program._interruptions", [signal.SIGINT])
    monkeypatch.setattr("cascadenorm.api.api.run_with_controls", failing)
    assert refused(capsys, "denoise", "ball.ply") == (130, "cascadenorm: interrupted; no file was left half written\n")


def test_interruption_is_exit_code_130(place, capsys, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("cascadenorm.api.api.run_with_controls", interrupt)
    code, message = refused(capsys, "denoise", "ball.ply", *FAST)
    assert code == 130 and "interrupted" in message
    assert not (place / "ball_denoised.ply").exists()


def test_an_error_of_ours_is_one_line_as_well(place, capsys, monkeypatch):
    def fail(*_, **__):
        raise KeyError("left over")

    monkeypatch.setattr("cascadenorm.api.api.run_with_controls", fail)
    code, message = refused(capsys, "denoise", "ball.ply", *FAST)
    assert code == 1 and "KeyError" in message and "report" in message
    monkeypatch.setenv("CASCADENORM_TRACEBACK", "1")
    with pytest.raises(KeyError):
        run(["denoise", "ball.ply", *FAST])


def test_a_reader_that_goes_away_leaves_no_traceback():
    code = "from cascadenorm.cli import main; main(['methods'])"
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([sys.executable, "-c", code], stdout=writing, stderr=subprocess.PIPE)
    os.close(writing)
    assert done.returncode == 1 and done.stderr == b""


@pytest.mark.skipif(sys.platform == "win32", reason="a POSIX shell closes the streams")
def test_closed_streams_are_no_error(place):
    code = "from cascadenorm.cli import main; main()"
    script = 'exec "$0" -c "$1" $2'
    for arguments, closed, expected in (("--version", ">&-", 0), ("inspect absent.ply", "2>&-", 3)):
        shell = ["sh", "-c", f"{script} {closed}", sys.executable, code, arguments]
        done = subprocess.run(shell, capture_output=True)
        assert (done.returncode, done.stdout, done.stderr) == (expected, b"", b"")


def test_exit_codes_leave_the_process(place):
    done = command("denoise", "absent.ply")
    assert done.returncode == 3 and done.stdout == b"" and done.stderr.count(b"\n") == 1
