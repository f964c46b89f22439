"""Run other programs on the noisy mesh of a pair."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from cascadenorm.errors import DenoiseError, OutputError, ParameterError
from cascadenorm.io.files import output_format
from cascadenorm.io.interop import as_mesh, save_mesh
from cascadenorm.mesh import Mesh, MeshError

PLACEHOLDER = re.compile(r"\{(in|out)(?:\.(\w+))?\}")
"""Placeholder for a file in a command; an extension selects the format of the file."""
TIMEOUT_S = 3600.0  # default time limit of a program for one mesh, in seconds
LAUNCHER = """
import json, subprocess, sys, time
start = time.perf_counter()
done = subprocess.run(sys.argv[2:], stdin=subprocess.DEVNULL)
seconds, memory = time.perf_counter() - start, None
try:
    import resource
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6
except ImportError:
    pass
with open(sys.argv[1], "w", encoding="utf-8") as file:
    json.dump([done.returncode, seconds, memory], file)
"""
"""A small process that starts the program, because the peak memory of a child includes that of its parent."""


def checked_command(name: str, command: str) -> list[str]:
    """Split a command into words and check it.

    Raises ParameterError if it lacks {in} or {out}, if the format of {in} cannot be written, or if the program does not
    exist.
    """
    try:
        words = command_words(command, windows=os.name == "nt")
    except ValueError as error:
        raise ParameterError(f"the command {name} cannot be read: {error}") from None
    places = [place for word in words for place in PLACEHOLDER.findall(word)]
    if {kind for kind, _ in places} != {"in", "out"}:
        raise ParameterError(f"the command {name} needs {{in}} and {{out}} in the place of its files: {command}")
    try:
        for kind, extension in places:
            if kind == "in" and extension:
                output_format(f"in.{extension}")
    except OutputError as error:
        raise ParameterError(f"the command {name} needs another {{in}}: {error}") from None
    if shutil.which(words[0]) is None:
        raise ParameterError(f"there is no program {words[0]}", hint="check the name, or give its path")
    return words


def command_words(command: str, *, windows: bool) -> list[str]:
    """Split a command at unquoted spaces; on Windows, backslashes are kept as part of paths."""
    reader = shlex.shlex(command, posix=True)
    reader.whitespace_split, reader.commenters = True, ""
    if windows:
        reader.escape = ""
    return list(reader)


def run_program(words: Sequence[str], noisy: Path, *, timeout: float = TIMEOUT_S) -> tuple[Mesh, float, float | None]:
    """Run the words of a command on a mesh file; the timeout, in seconds, stops the program and its child processes.

    {in} is the given file, and {out} a file of the same format; {in.obj} and {out.obj} are OBJ files. Raises
    DenoiseError if the program fails, exceeds the timeout, or writes no file, and ReadError or MeshError if its output
    is not a valid mesh.
    """
    with TemporaryDirectory() as folder:
        files: dict[str, Path] = {}

        def named(place: re.Match[str]) -> str:
            kind, extension = place.groups()
            files[place[0]] = path = Path(folder) / f"{kind}.{extension or noisy.suffix[1:]}"
            if kind == "in" and not path.exists():
                if extension is None:
                    return str(noisy.resolve())
                save_mesh(path, as_mesh(noisy))
            return str(path)

        filled = [PLACEHOLDER.sub(named, word) for word in words]
        report = Path(folder) / "report.json"
        launched = [sys.executable, "-S", "-c", LAUNCHER, str(report), *filled]
        done = _run_within(launched, timeout, words[0])
        code, seconds, memory = done.returncode, 0.0, None
        if report.exists():
            code, seconds, memory = json.loads(report.read_text(encoding="utf-8"))
        if code:
            lines = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
            raise DenoiseError(f"{words[0]} ended with code {code}{': ' + lines[-1] if lines else ''}")
        written = next(path for place, path in files.items() if place.startswith("{out"))
        if not written.exists():
            raise DenoiseError(f"{words[0]} wrote no file {written.name}")
        try:
            return as_mesh(written), seconds, memory
        except MeshError as error:
            raise error.within(written.name) from None


def _run_within(command: Sequence[str], timeout: float, name: str) -> subprocess.CompletedProcess[str]:
    """Run a command in its own process group, which is killed as a whole after the timeout or on an interrupt."""
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
        start_new_session=True,
    ) as process:
        try:
            output, complaints = process.communicate(timeout=min(timeout, threading.TIMEOUT_MAX))
        except BaseException as error:
            _kill_group(process)
            if isinstance(error, subprocess.TimeoutExpired):
                raise DenoiseError(f"{name} took longer than {timeout:g} seconds, and was stopped") from None
            raise
    return subprocess.CompletedProcess(list(command), process.returncode, output, complaints)


def _kill_group(process: subprocess.Popen[str]) -> None:
    if sys.platform == "win32":
        subprocess.run(["taskkill", "/T", "/F", "/PID", str(process.pid)], capture_output=True, check=False)
    else:
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
