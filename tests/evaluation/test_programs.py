"""Other programs as rows of an evaluation."""

import re
import shlex
import sys
import time

import pytest
from evaluated import COPY, SHAPES, python

from cascadenorm.errors import ParameterError
from cascadenorm.evaluation.harness import NOISY, evaluate
from cascadenorm.evaluation.programs import command_words


def test_a_program_is_run_on_each_noisy_mesh_timed_and_measured(folder):
    done = evaluate(folder, methods=[], commands={"copy": python(COPY)})
    assert [(r.pair, r.method) for r in done.results] == [(n, m) for n in SHAPES for m in (NOISY, "copy")]
    for before, after in zip(done.results[::2], done.results[1::2], strict=True):
        assert after.measures == before.measures and after.seconds > 0
        assert before.seconds == 0 and before.memory_mb is None
    if sys.platform.startswith("linux"):
        assert all(120 < result.memory_mb < 180 for result in done.results[1::2])  # not that of this process


def test_a_program_gets_files_of_the_format_that_it_asks_for(folder, tmp_path):
    script = tmp_path / "their tool.py"
    script.write_text(
        "import sys\n"
        "assert sys.argv[1].endswith('.obj') and sys.argv[2].endswith('.off')\n"
        "from cascadenorm.io.interop import as_mesh, save_mesh\n"
        "from pathlib import Path\n"
        "save_mesh(Path(sys.argv[2]), as_mesh(sys.argv[1]))\n"
    )
    command = f"{sys.executable} '{script}' {{in.obj}} {{out.off}}"
    done = evaluate(folder / "ball", methods=[], commands={"theirs": command})
    assert done.failures == []
    errors = [result.measures.normal_error_deg for result in done.results]
    assert errors[1] == pytest.approx(errors[0], abs=1e-3)


def test_the_failures_of_a_program_are_shown_and_the_rest_goes_on(folder):
    commands = {
        "dies": python("import sys; print('no such grid', file=sys.stderr); sys.exit(3)"),
        "silent": python("pass"),
        "rubbish": python("import sys; open(sys.argv[2], 'w').write('ply')"),
        "copy": python(COPY),
    }
    done = evaluate(folder / "ball", methods=[], commands=commands)
    assert [result.method for result in done.results] == [NOISY, "copy"]
    said = {failure.method: str(failure.error) for failure in done.failures}
    assert said["dies"].endswith("ended with code 3: no such grid")
    assert said["silent"].endswith("wrote no file out.ply") and said["rubbish"].startswith("out.ply: ")


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("cp {in} somewhere", "needs {in} and {out}"),
        ("cp {in.docx} {out}", "needs another {in}: the format 'docx' cannot be written"),
        ("no-such-program {in} {out}", "there is no program no-such-program"),
        ("cp '{in} {out}", "cannot be read"),
    ],
)
def test_commands_that_cannot_run_are_refused_before_any_work(folder, command, message):
    with pytest.raises(ParameterError, match=re.escape(message)):
        evaluate(folder, methods=[], commands={"theirs": command})


def test_names_of_rows_differ_and_can_be_those_of_files(folder):
    with pytest.raises(ParameterError, match="two rows are named 'one'"):
        evaluate(folder, methods=[], commands={"one": "cp {in} {out}"}, results={"one": folder})
    with pytest.raises(ParameterError, match="which is not a file name"):
        evaluate(folder, methods=[], commands={"a/b": "cp {in} {out}"})


@pytest.mark.skipif(sys.platform == "win32", reason="the program is a shell")
def test_a_program_that_takes_too_long_is_stopped_with_all_that_it_started(folder, tmp_path):
    alive = tmp_path / "alive"
    waits = f"while true; do touch {shlex.quote(str(alive))}; sleep 0.05; done"
    command = f"sh -c {shlex.quote(f'({waits}) & wait; : {{in}} {{out}}')}"
    done = evaluate(folder / "ball", methods=[], commands={"hangs": command}, timeout=2.0)
    (failure,) = done.failures
    assert failure.method == "hangs" and "took longer than 2 seconds, and was stopped" in str(failure.error)
    alive.unlink(missing_ok=True)
    time.sleep(0.5)
    assert not alive.exists()
    with pytest.raises(ParameterError, match="timeout is 0"):
        evaluate(folder, methods=[], timeout=0)


def test_backslashes_are_kept_on_windows_and_quotes_are_read_everywhere():
    command = r'"C:\Program Files\tool.exe" {in} C:\out\{out} \\server\share'
    expected = [r"C:\Program Files\tool.exe", "{in}", r"C:\out\{out}", r"\\server\share"]
    assert command_words(command, windows=True) == expected
    assert command_words(r"tool\ 1 'a b' {in} #3", windows=False) == ["tool 1", "a b", "{in}", "#3"]
