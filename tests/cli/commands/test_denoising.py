"""The commands that denoise write the result of the library, say what they did, and refuse impossible files."""

import io
import json
import os
from pathlib import Path

import numpy as np
import pytest
from commands import FAST, ROUGH, command, refused
from partitions import walls
from shapes import cube, icosphere

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.registry.controls import CONTROLS


def test_missing_files_and_folders(place, capsys):
    code, message = refused(capsys, "denoise", "absent.ply", *FAST)
    assert code == 3 and "absent.ply does not exist" in message
    for words in (["denoise", *FAST], ["fill-holes"], ["denoise-regions", "-o", "out", *FAST]):
        code, message = refused(capsys, *words, "absent")
        assert code == 3 and "absent does not exist: check the name" in message
    assert refused(capsys, "denoise", ".", "-o", "out.ply", *FAST)[0] == 3
    for name in ("", ".", "..", "/"):
        for words in (("denoise", name, *FAST), ("fill-holes", name)):
            code, message = refused(capsys, *words)
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
    for words in ["denoise", "ball.ply", *FAST], ["fill-holes", "ball.ply"]:
        code, line = refused(capsys, *words, "-o", output)
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
    assert run(["fill-holes", "ball"]) == run(["batch", "ball", "-o", "out", *FAST, "--workers", "1"]) == 0
    assert cn.read("ball_filled").format == cn.read("out/ball").format == "ply"


def test_devices_get_the_format_that_was_read(place):
    assert run(["denoise", "ball.ply", *FAST, "-o", os.devnull]) == 0


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder(place, capsys):
    (place / "locked").mkdir(mode=0o500)
    assert refused(capsys, "denoise", "ball.ply", "-o", "locked/out.ply", *FAST)[0] == 5


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
    assert run(["denoise", "ball.ply", *FAST, "-o", "out.ply"]) == 0
    assert by_name.stdout == (place / "out.ply").read_bytes()


def test_a_stream_has_the_format_that_is_asked_for(place, capsys):
    data = (place / "ball.ply").read_bytes()
    done = command("denoise", "-", *FAST, "--format", "off", stdin=data)
    assert done.returncode == 0 and done.stdout.startswith(b"OFF")
    expected = cn.denoise(ROUGH, method="laplacian").vertices
    np.testing.assert_array_equal(cn.read(io.BytesIO(done.stdout)).mesh.vertices, expected)
    code, message = refused(capsys, "denoise", "-", *FAST, "--format", "doc")
    assert code == 5 and "'doc' cannot be written" in message
    code, message = refused(capsys, "denoise", "ball.ply", *FAST, "--format", "off")
    assert code == 2 and "--format applies to stdout only" in message


def test_a_report_is_named_when_it_is_written(place, capsys):
    pytest.importorskip("PIL")
    assert run(["denoise", "ball.ply", *FAST, "--report", "report.html"]) == 0
    assert "report: report.html\n" in capsys.readouterr().out
    assert run(["inspect", "ball.ply", "--report", "inspected.html"]) == 0
    assert "report: inspected.html\n" in capsys.readouterr().out
