"""Messages and exit codes of commands that refuse their input, options or outputs."""

import os
import signal
import subprocess
import sys

import pytest
from commands import FAST, command, refused
from shapes import grid

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.cli.errors import worded
from cascadenorm.cli.options import OTHER_OPTIONS
from cascadenorm.io.interop import save_mesh

OFF = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"


@pytest.mark.parametrize(
    ("words", "suggests"),
    [
        ("compare bad.obj true.ply", False),
        ("compare bad.obj true.ply --report r.html", False),
        ("spectrum bad.obj", False),
        ("fill-holes bad.obj", False),
        ("render bad.obj -o a.png", False),
        ("denoise true.ply --report r.html --truth bad.obj", False),
        ("denoise bad.obj", True),
        ("denoise bad.obj --weld 0.1", True),
        ("denoise bad.obj --drop-components 10", True),
        ("denoise-regions bad.obj true.ply -o out", True),
    ],
)
def test_isolating_is_suggested_only_where_it_helps(place, capsys, words, suggests):
    (place / "bad.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", encoding="ascii")
    code, message = refused(capsys, *words.split())
    assert code == 4 and "not finite" in message and ("--on-bad isolate" in message) == suggests


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


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ("render ball.ply -o -", 5),
        ("evaluate . --csv -", 5),
        ("models --hub -", 5),
        ("fill-holes - -o a.ply", 3),
        ("render - -o a.png", 3),
    ],
)
def test_a_hyphen_is_no_file_where_streams_are_not_supported(place, capsys, arguments, code):
    before = sorted(place.rglob("*"))
    found, message = refused(capsys, *arguments.split())
    stream = "standard output" if code == 5 else "standard input"
    assert found == code and f"{stream} cannot be used" in message
    assert sorted(place.rglob("*")) == before


def test_pages_of_an_evaluation_are_html_files_as_reports_are(place, capsys):
    for words in (["evaluate", ".", "--html", "a.txt", "--keep", "kept"], ["inspect", "ball.ply", "--report", "a.txt"]):
        code, message = refused(capsys, *words)
        assert code == 5 and "a.txt is not the name of an HTML file: end it in .html" in message


def test_arguments_are_named_as_options_and_parameters_of_methods_are_not(place, capsys):
    assert not OTHER_OPTIONS & {name for method in cn.methods().values() for name in method.settings}
    for arguments, told in (
        ("render ball.ply -o a.png --values bogus", "--values is 'bogus'; it must be one of angle, "),
        ("batch ball.ply -o out --memory much", "--memory is 'much'"),
        (f"denoise ball.ply --memory {'9' * 400}GB", "--memory is '99"),
        ("denoise ball.ply --scheduler local", "--scheduler works on patches"),
        (
            "denoise ball.ply --method fairing",
            "fairing needs a region: denoise with a mask of the vertices",
        ),
        ("train --quick --threads 0 -o w.safetensors", "--threads is 0; it must be at least 1\n"),
        ("train-gate ball.ply ball.ply --threads 0 -o w.safetensors", "--threads is 0; it must be at least 1\n"),
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


def test_a_file_in_the_place_of_a_command_is_told_with_a_command_that_works(place, capsys):
    (place / "ball.ply").rename("my ball.ply")
    code, message = refused(capsys, "my ball.ply")
    assert code == 2 and "to denoise it, use `cascadenorm denoise 'my ball.ply'`" in message


def test_a_file_whose_name_begins_like_an_option_is_told_with_a_name_that_works(place, capsys):
    (place / "ball.ply").rename("-ball.ply")
    code, message = refused(capsys, "inspect", "-ball.ply")
    assert code == 2 and "No such option" in message and "for the file -ball.ply write ./-ball.ply" in message
    assert run(["inspect", "./-ball.ply"]) == 0


# bad input

BAD_FILES = {
    "empty.ply": (b"", 3, "empty.ply: the file is empty"),
    "text.ply": (b"Dear Sir or Madam,\n", 3, "text.ply"),
    "text.xyz": (b"1 2 3\n4 5 6\n", 3, "text.xyz"),
    "random.stl": (bytes(range(256)) * 4, 3, "random.stl"),
    "index.off": (OFF.replace("3 2 0 3", "3 2 0 9").encode(), 4, "index.off: 1 face uses vertices that do not exist"),
    "nan.off": (OFF.replace("0 0 1\n", "0 0 nan\n").encode(), 4, "nan.off: 1 of 4 vertices are not finite"),
    "short.stl": (b"hello\n", 3, "short.stl: the file has 6 bytes, fewer than the 84 of a header"),
    "nothing.gltf": (b"{}", 4, "nothing.gltf: the file has no vertices and no faces: export the mesh again"),
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


COLLECTIONS = """
import gc, sys
from cascadenorm.__main__ import main
started = []
gc.callbacks.append(lambda phase, _: started.append(phase))
sys.argv = ["cascadenorm", "methods"]  # which loads all libraries, and compiles nothing
try:
    main()
except SystemExit as end:
    print(end.code, len(started), file=sys.stderr)
"""


def test_python_does_not_search_for_garbage_while_libraries_load():
    done = subprocess.run([sys.executable, "-c", COLLECTIONS], capture_output=True, text=True)
    assert done.stderr.splitlines()[-1] == "0 0"


def test_lack_of_memory_is_not_blamed_on_a_mesh():
    assert worded(MemoryError()) == "there is not enough memory"  # as for `render --size 100000`


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["denoise", f"{LONG}.ply"], 5),
        (["fill-holes", f"{LONG}.ply"], 5),
        (["studio", "--no-browser", f"{LONG}.ply"], 3),
        (["generate", LONG], 5),
        (["evaluate", LONG], 3),
        (["train", "--noisy", LONG], 3),
        (["train", "--shapes", LONG], 3),
    ],
    ids=lambda value: " ".join(value)[:15] if isinstance(value, list) else "",
)
def test_a_name_that_the_system_rejects_is_no_fault_of_the_program(words, code, place, capsys):
    if words[0] == "train":
        pytest.importorskip("torch")
    assert run(words) == code
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and "please report it" not in message
