"""Every command refuses wrong usage before any work, and ends in one line however it ends."""

import os
import signal
import subprocess
import sys

import pytest
from commands import FAST, ROUGH, command, refused

import cascadenorm as cn
from cascadenorm.cli import main, run
from cascadenorm.io.interop import save_mesh


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


def test_several_files_are_left_to_batch(place, capsys):
    code, message = refused(capsys, "denoise", "ball.ply", "true.ply", *FAST)
    assert code == 2 and "true.ply" in message and "to denoise several files use `cascadenorm batch`" in message


def test_a_file_in_place_of_a_command_is_answered_with_the_command_that_denoises_it(place, capsys):
    code, message = refused(capsys, "ball.ply")
    assert code == 2 and "to denoise it, use `cascadenorm denoise ball.ply`" in message
    code, message = refused(capsys, "polish")
    assert code == 2 and "cascadenorm denoise" not in message
    assert message == "cascadenorm: No such command 'polish' (see `cascadenorm --help`)\n"


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


@pytest.mark.parametrize(
    "line",
    ["evaluate pairs --csv same.md --markdown ./same.md", "render pairs/ball/clean.ply -o a.webp --turntable a.webp"],
)
def test_two_outputs_that_are_the_same_file_are_refused(line, pairs, monkeypatch, capsys):
    monkeypatch.chdir(pairs.parent)
    code, message = refused(capsys, *line.split())
    assert code == 5 and "several outputs are the same file" in message
    assert [path.name for path in pairs.parent.iterdir()] == ["pairs"]


def test_an_interruption_while_the_program_is_loaded_is_one_line(capsys, monkeypatch):
    def interrupt(name):
        raise KeyboardInterrupt

    monkeypatch.setattr("cascadenorm.cli.import_module", interrupt)
    with pytest.raises(SystemExit) as ended:
        main(["methods"])
    assert ended.value.code == 130
    assert capsys.readouterr().err == "cascadenorm: interrupted; no file was left half written\n"


@pytest.mark.skipif(os.name == "nt", reason="a process cannot send itself Ctrl-C there")
@pytest.mark.parametrize("name", ["cascadenorm.cli", "cascadenorm.cli.program", "typer", "cascadenorm.api.api"])
def test_an_interruption_of_any_import_is_one_line(name):
    code = f"""
import os, runpy, signal, sys
class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupts())
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv[1:] = ["methods"]
runpy.run_module("cascadenorm", run_name="__main__", alter_sys=True)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "cascadenorm: interrupted; no file was left half written\n")


def test_worker_processes_do_not_run_the_script_that_started_the_program(tmp_path):
    """A script without a guard, as some installers write it, would start the program again in each of them."""
    script = tmp_path / "cascadenorm"
    script.write_text("import sys\nfrom cascadenorm.cli import main\nsys.exit(main())\n")
    save_mesh(tmp_path / "a.ply", ROUGH)
    options = ["a.ply", "--method", "laplacian", "--workers", "1", "-o", "out"]
    done = subprocess.run([sys.executable, script, "batch", *options], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in (tmp_path / "out").glob("*.ply")] == ["a.ply"]
