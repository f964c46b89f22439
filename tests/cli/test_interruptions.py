"""Interruptions end in one line whenever they come, and workers do not run the script that started the program."""

import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from shapes import icosphere, noisy

from cascadenorm.cli import main
from cascadenorm.execution.signals import repeat_if_swallowed
from cascadenorm.io.interop import save_mesh

ROUGH = noisy(icosphere(2), 0.2)


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
    for name in ("a.ply", "b.ply"):
        save_mesh(tmp_path / name, ROUGH)
    options = ["a.ply", "b.ply", "--method", "laplacian", "--workers", "2", "-o", "out"]
    done = subprocess.run([sys.executable, script, "batch", *options], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in (tmp_path / "out").glob("*.ply")) == ["a.ply", "b.ply"]


def test_an_interruption_that_cannot_be_raised_comes_again(monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # it is ignored in the background of a shell
    try:
        repeat_if_swallowed(signal.SIGINT, KeyboardInterrupt)
        sys.unraisablehook(SimpleNamespace(exc_type=KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            for _ in range(60_000):
                time.sleep(0.01)
    finally:
        signal.signal(signal.SIGINT, before)
