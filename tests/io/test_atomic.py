"""No half files: whatever happens while one is written, the old one or the new one is there, whole."""

import os
import signal
import stat
import subprocess
import sys
import threading
from io import BytesIO, RawIOBase, TextIOWrapper
from pathlib import Path

import pytest
from sample_files import PLY_TEXT
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import main, run
from cascadenorm.io import OutputError
from cascadenorm.io.atomic import (
    check_output,
    remove_unfinished,
    unfinished_name,
    write_atomically,
    write_stream,
    write_together,
)
from cascadenorm.io.interop import save_mesh

FAST = ["--method", "laplacian"]
STOPPED = """
import os, sys, time
from pathlib import Path
from cascadenorm.io.atomic import write_atomically

def stop(*_):
    os.write(1, b"stopped\\n")
    while True:  # until it is killed
        time.sleep(60)

def pieces():
    yield b"new" * 100_000
    if stage == "writing":
        stop()

for name in sys.argv[1:]:  # a process for each
    if os.fork() == 0:
        stage = name.split("-")[0]
        if stage != "writing":
            setattr(os, stage, stop)
        write_atomically(Path(name, "out.ply"), pieces(), force=True)
        os.write(1, name.encode() + b" was not stopped\\n")
        break
stop()
"""
STAGES = [f"{stage}-{old}" for stage in ("writing", "fsync", "replace") for old in ("none", "old")] + ["chmod-old"]


@pytest.fixture
def ball(tmp_path, monkeypatch) -> Path:
    """A mesh file of some size in the working directory."""
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / "ball.ply", noisy(icosphere(3), 0.2))
    return tmp_path / "ball.ply"


@pytest.fixture(scope="module")
def killed(tmp_path_factory) -> Path:
    """A folder for each stage of the writing of a file, at which a process was killed."""
    root = tmp_path_factory.mktemp("killed")
    for name in STAGES:
        (root / name).mkdir()
        if name.endswith("-old"):
            (root / name / "out.ply").write_bytes(b"old")
    command = [sys.executable, "-c", STOPPED, *STAGES]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=root, start_new_session=True) as process:
        said = [process.stdout.readline() for _ in range(len(STAGES) + 1)]  # that of the process that started them too
        os.killpg(process.pid, signal.SIGKILL)
    assert set(said) == {b"stopped\n"}
    return root


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.parametrize("name", STAGES)
def test_a_killed_process_leaves_what_was_there(killed, name):
    folder, target = killed / name, killed / name / "out.ply"
    assert (target.read_bytes() if target.exists() else None) == (b"old" if name.endswith("-old") else None)
    rest = [path.name for path in folder.iterdir() if path != target]
    assert rest and all(name.startswith(".") and name.endswith(".part") for name in rest)
    remove_unfinished([folder / "out.obj"])
    assert [path.name for path in folder.iterdir() if path != target] == rest  # another output, of the same stem
    remove_unfinished([target])
    assert [path for path in folder.iterdir() if path != target] == []


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_new_files_have_the_permissions_of_new_files_and_others_keep_theirs(tmp_path, monkeypatch):
    before = os.umask(0o027)
    monkeypatch.setattr(os, "umask", None)  # which is the process's, not ours
    try:
        write_atomically(tmp_path / "new.ply", [b"new"])
        (tmp_path / "old.ply").touch()
        for mode in (0o600, 0o666):
            (tmp_path / "old.ply").chmod(mode)
            write_atomically(tmp_path / "old.ply", [b"new"], force=True)
            assert (tmp_path / "old.ply").stat().st_mode & 0o777 == mode
    finally:
        monkeypatch.undo()
        os.umask(before)
    assert (tmp_path / "new.ply").stat().st_mode & 0o777 == 0o640


TERMINATED = """
import os, signal
import cascadenorm.api.api, cascadenorm.cli.program
from cascadenorm.cli import main
for number in (signal.SIGTERM, signal.SIGHUP):  # SIGHUP: its terminal is closed
    signal.signal(number, signal.SIG_DFL)  # under nohup, SIGHUP is ignored
    child = os.fork()
    if child == 0:
        os.fsync = lambda handle: os.kill(os.getpid(), number)
        main()
    print(number - os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_terminated_command_removes_its_temporary_file(ball):
    command = [sys.executable, "-c", TERMINATED, "denoise", "ball.ply", *FAST]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    assert done.stdout.split() == ["-128", "-128"]
    assert os.listdir() == ["ball.ply"]


@pytest.fixture
def full_disk():
    """Files that may not grow beyond 5000 bytes."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("old", [None, b"precious"])
def test_a_full_disk_leaves_what_was_there(ball, old, full_disk, capsys):
    if old is not None:
        Path("out.ply").write_bytes(old)
    before = sorted(os.listdir())
    assert run(["denoise", "ball.ply", *FAST, "-o", "out.ply", "--force"]) == 5
    assert capsys.readouterr().err == "cascadenorm: out.ply cannot be written: File too large\n"
    assert sorted(os.listdir()) == before
    assert old is None or Path("out.ply").read_bytes() == old


FULL = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full here")


@FULL
def test_a_full_device_is_one_line_and_exit_code_5(ball, capsys):
    assert run(["denoise", "ball.ply", *FAST, "-o", "/dev/full"]) == 5
    assert capsys.readouterr().err == "cascadenorm: /dev/full cannot be written: No space left on device\n"


TWICE = """
import os, sys
import cascadenorm.api.api, cascadenorm.cli.program
from cascadenorm.cli import main
if child := os.fork():
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    print("exit code", code, file=sys.stderr)
    main(["methods"])
main()
"""


@FULL
def test_a_full_stdout_is_one_line_and_exit_code_5(ball):
    """Of a mesh, and of text."""
    words = ["denoise", "ball.ply", *FAST, "-o", "-"]
    with open("/dev/full", "wb") as full:
        done = subprocess.run([sys.executable, "-c", TWICE, *words], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 5
    of_mesh, code, of_text = done.stderr.splitlines()
    assert code == "exit code 5"
    for line in (of_mesh, of_text):
        assert line.endswith("cannot be written: No space left on device")


def test_of_several_files_none_is_new_unless_all_are_complete(tmp_path):
    def broken():
        yield b"half"
        raise OSError(28, "No space left on device")

    for force in (False, True):
        with pytest.raises(OutputError, match="b cannot be written: No space left"):
            write_together([(tmp_path / "a", [b"new"]), (tmp_path / "b", broken())], force=force)
        assert not os.listdir(tmp_path)
    write_together([(tmp_path / "a", [b"1"]), (tmp_path / "b", [b"2"])])
    assert (tmp_path / "a").read_bytes() + (tmp_path / "b").read_bytes() == b"12"


def test_a_link_keeps_pointing_to_what_is_replaced(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link.ply").symlink_to("there/real.ply")
    write_atomically(tmp_path / "link.ply", [b"first"])
    assert (tmp_path / "there" / "real.ply").read_bytes() == b"first"
    with pytest.raises(OutputError, match="exists already"):
        write_atomically(tmp_path / "link.ply", [b"second"])
    write_atomically(tmp_path / "link.ply", [b"second"], force=True)
    assert (tmp_path / "link.ply").is_symlink() and (tmp_path / "there" / "real.ply").read_bytes() == b"second"
    assert sorted(os.listdir(tmp_path)) == ["link.ply", "there"] and os.listdir(tmp_path / "there") == ["real.ply"]


def test_existing_file_needs_force(tmp_path, tetrahedron):
    path = tmp_path / "a.ply"
    path.write_bytes(b"precious")
    with pytest.raises(io.OutputError, match="force"):
        io.write(tetrahedron, path)
    assert path.read_bytes() == b"precious"
    path.chmod(0o640)
    io.write(tetrahedron, path, force=True)
    assert len(io.read(path).mesh.faces) == 4
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert os.listdir(tmp_path) == ["a.ply"]


@pytest.mark.parametrize("force", [True, False])
def test_failing_write_leaves_everything_as_it_was(force, tmp_path, tetrahedron, monkeypatch):
    path = tmp_path / "a.ply"
    if force:
        path.write_bytes(b"precious")

    def full_disk(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(io.OutputError, match="No space left"):
        io.write(tetrahedron, path, force=force)
    assert os.listdir(tmp_path) == (["a.ply"] if force else [])
    assert not force or path.read_bytes() == b"precious"


def test_interrupted_write_leaves_nothing(tmp_path, tetrahedron, monkeypatch):
    def interrupt(handle):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        io.write(tetrahedron, tmp_path / "a.ply")
    assert not os.listdir(tmp_path)


def test_file_that_appears_meanwhile_is_not_overwritten(tmp_path, tetrahedron, monkeypatch):
    path = tmp_path / "a.ply"
    monkeypatch.setattr(os, "fsync", lambda handle: path.write_bytes(b"precious"))
    with pytest.raises(io.OutputError, match="another process created"):
        io.write(tetrahedron, path)
    assert os.listdir(tmp_path) == ["a.ply"]
    assert path.read_bytes() == b"precious"


def test_link_is_followed(tmp_path, tetrahedron):
    (tmp_path / "real.ply").write_bytes(b"old")
    (tmp_path / "link.ply").symlink_to("real.ply")
    io.write(tetrahedron, tmp_path / "link.ply", force=True)
    assert (tmp_path / "link.ply").is_symlink()
    assert len(io.read(tmp_path / "real.ply").mesh.faces) == 4


def test_device_is_written_to_and_not_replaced(tetrahedron):
    io.write(tetrahedron, os.devnull, format="ply")
    assert not stat.S_ISREG(os.stat(os.devnull).st_mode)


def test_temporary_files_of_killed_processes_are_removed_and_no_others(tmp_path):
    alike = [f"{'x' * 50}-{number}.ply" for number in (1, 2)]  # the same first 40 characters
    outputs = ["scan.ply", alike[0], "part.gltf"]
    mine = [unfinished_name(name, tmp_path / name) for name in outputs]
    mine += [unfinished_name(name, tmp_path / "part.gltf") for name in ("part.bin", "texture.png")]
    owners = ["scan.obj", "scan.stl", alike[1], "other.ply"]  # the same stem; the same beginning
    others = [unfinished_name(name, tmp_path / name) for name in owners]
    others += ["scan.ply", ".scan.ply.part", ".scan.ply.notes.part"]
    for name in (*mine, *others):
        (tmp_path / name).touch()
    remove_unfinished([*(tmp_path / name for name in outputs), tmp_path / "nowhere" / "scan.ply"])
    assert sorted(os.listdir(tmp_path)) == sorted(others)


PIECES = [bytes(range(256)) * 2000, b"", memoryview(b"end")]
WHOLE = b"".join(bytes(piece) for piece in PIECES)


class Short(RawIOBase):
    """A raw stream that takes a few bytes at a time."""

    def __init__(self) -> None:
        self.taken = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, data) -> int:
        self.taken += bytes(data[:1000])
        return min(len(data), 1000)


def test_a_stream_that_takes_few_bytes_at_a_time_gets_all():
    stream = Short()
    write_stream(stream, PIECES)
    assert stream.taken == WHOLE


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no FIFOs here")
@pytest.mark.parametrize("buffering", [0, -1])
def test_a_pipe_that_does_not_block_gets_all(buffering):
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    found = []

    def drain() -> None:
        with open(read_end, "rb") as stream:
            found.append(stream.read())

    thread = threading.Thread(target=drain)
    with open(write_end, "wb", buffering=buffering) as stream:
        thread.start()
        write_stream(stream, PIECES)
    thread.join()
    assert found == [WHOLE]


def test_a_reader_that_leaves_is_an_error():
    read_end, write_end = os.pipe()
    os.close(read_end)
    with pytest.raises(OutputError, match="closed by its reader"), open(write_end, "wb", buffering=0) as stream:
        write_stream(stream, PIECES)


READ_AND_NOT_READ = """
import os, sys
from cascadenorm.cli import main, run
code = run(sys.argv[1:])
if code:
    sys.exit(f"exit code {code}")
read_end, write_end = os.pipe()
os.close(read_end)
os.dup2(write_end, 1)
main()
"""


def test_the_command_line_writes_all_without_buffers(tmp_path):
    """A reader that leaves early, and one that stays, with an unbuffered stdout."""
    (tmp_path / "a.ply").write_bytes(PLY_TEXT)
    command = [sys.executable, "-c", READ_AND_NOT_READ, "denoise", "a.ply", "-o", "-", *FAST]
    unbuffered = {**os.environ, "PYTHONUNBUFFERED": "1"}
    done = subprocess.run(command, cwd=tmp_path, env=unbuffered, capture_output=True)
    assert run(["denoise", str(tmp_path / "a.ply"), "-o", str(tmp_path / "b.ply"), *FAST]) == 0
    assert done.stdout == (tmp_path / "b.ply").read_bytes()
    assert done.returncode == 5
    *_, message = done.stderr.splitlines()  # after what it says of the mesh that was written
    assert message == b"cascadenorm: the stream was closed by its reader before all was written"
    assert done.stderr.count(b"cascadenorm: ") == 1 and b"Traceback" not in done.stderr


# names


def said(monkeypatch, *arguments: str) -> tuple[int, bytes]:
    """Run the program on streams that are strict about encodings; its exit code, and what it printed."""
    stream = TextIOWrapper(BytesIO(), encoding="utf-8")
    monkeypatch.setattr(sys, "stdout", stream)
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as end:
        main(arguments)
    stream.flush()
    return end.value.code, stream.buffer.getvalue()


@pytest.mark.skipif(sys.platform != "linux", reason="names are any bytes on Linux alone")
def test_names_of_any_bytes(ball, monkeypatch):
    name = b"caf\xe9 \xff\n.ply"
    os.rename("ball.ply", name)
    assert said(monkeypatch, "denoise", os.fsdecode(name), *FAST)[0] == 0
    assert len(cn.read(os.fsdecode(b"caf\xe9 \xff\n_denoised.ply")).mesh.faces) == 1280
    code, text = said(monkeypatch, "denoise", os.fsdecode(b"\xff.ply"))
    assert code == 3 and text == b"cascadenorm: \\udcff.ply does not exist: check the name\n"


def test_names_that_cannot_be_are_refused_in_words(ball, capsys):
    for name, words in {"n" * 300: "File name too long", "zero\0byte.ply": "null"}.items():
        assert run(["denoise", name, *FAST, "-o", "out.ply"]) == 3
        assert words in capsys.readouterr().err
        assert run(["denoise", "ball.ply", *FAST, "-o", f"{name}.ply"]) == 5
        assert words in capsys.readouterr().err


@pytest.mark.parametrize("url", ["https://example.org/a.ply", "s3://bucket/folder/a.ply"])
def test_an_output_at_a_url_is_refused_in_words(url, ball, capsys):
    assert run(["denoise", "ball.ply", *FAST, "-o", url]) == 5
    assert f"{url} is a URL: give the name of a local file" in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt", reason="Windows does not remove the current folder")
def test_a_current_folder_that_was_removed_is_named(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(OutputError, match=r"out\.ply cannot be written: the current folder does not exist any more"):
        check_output(Path("out.ply"), force=False)
    check_output(tmp_path / "out.ply", force=False)
