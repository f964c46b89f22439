"""Results reach a stream whole, or the command fails; meshes come from pipes as well."""

import io
import os
import re
import subprocess
import sys
import tempfile
import threading

import pytest
from sample_files import PLY_TEXT
from shapes import icosphere

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io import OutputError
from cascadenorm.io.atomic import write_stream

PIECES = [bytes(range(256)) * 2000, b"", memoryview(b"end")]
WHOLE = b"".join(bytes(piece) for piece in PIECES)


class Short(io.RawIOBase):
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


def closed(stream):
    stream.close()
    return stream


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: closed(io.BytesIO(PLY_TEXT)), "the stream cannot be read: I/O operation on closed file"),
        (lambda path: path.open("ab"), 'b.ply cannot be read: open the file in binary mode, "rb"'),
        (lambda path: path.open(encoding="ascii"), 'b.ply is a text stream: open the file in binary mode, "rb"'),
        (lambda path: io.StringIO("OFF"), 'the stream is a text stream: open the file in binary mode, "rb"'),
        (
            lambda path: tempfile.TemporaryFile(),  # noqa: SIM115 - the test closes it
            "the stream: the file is empty",
        ),
    ],
    ids=["closed", "for writing", "text", "text in memory", "empty"],
)
def test_streams_that_cannot_be_read_are_refused(make, words, tmp_path):
    (tmp_path / "b.ply").write_bytes(b"\xff" + PLY_TEXT)
    stream = make(tmp_path / "b.ply")
    with pytest.raises(cn.ReadError, match=re.escape(words)):
        cn.read(stream)
    stream.close()


def test_a_stream_of_any_kind_of_bytes_is_read():
    class Views:
        def read(self):
            return memoryview(PLY_TEXT)

    assert cn.read(Views()).data == PLY_TEXT


class Unwritable(io.BytesIO):
    """Behaves like a file that was opened for reading."""

    def writable(self):
        return False


@pytest.mark.parametrize("source", [5, None, icosphere(1)])
def test_sources_that_are_neither_a_path_nor_a_stream_are_refused_as_such(source):
    for read in (cn.read, cn.denoise_file):
        with pytest.raises(
            cn.ReadError,
            match=f"source is of type {type(source).__name__}, which is neither a path nor a stream of bytes",
        ):
            read(source)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (closed(io.BytesIO()), "the stream cannot be written: it is closed"),
        (io.StringIO(), 'the stream is a text stream: open the file in binary mode, "wb"'),
        (cn.read(io.BytesIO(PLY_TEXT)), "the output is of type PlyFile, which is neither a path nor a stream of bytes"),
        (Unwritable(), 'the stream cannot be written: open the file in binary mode, "wb"'),
        (b"a.ply", "the output is of type bytes, which is neither a path nor a stream of bytes"),
    ],
    ids=["closed", "text", "mesh", "for reading", "bytes"],
)
def test_targets_that_take_no_bytes_are_refused_before_anything_is_read(target, words):
    with pytest.raises(OutputError, match=re.escape(words)):
        cn.write(cn.read(io.BytesIO(PLY_TEXT)), target)
    source = io.BytesIO(PLY_TEXT)
    with pytest.raises(OutputError, match=re.escape(words)):
        cn.denoise_file(source, target)
    assert source.tell() == 0


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


def test_the_command_line_writes_all_without_buffers(tmp_path):
    """A reader that leaves early, and one that stays, with an unbuffered stdout."""
    (tmp_path / "a.ply").write_bytes(PLY_TEXT)
    command = [sys.executable, "-m", "cascadenorm", "denoise", "a.ply", "-o", "-", "--method", "laplacian"]
    unbuffered = {**os.environ, "PYTHONUNBUFFERED": "1"}
    whole = subprocess.run(command, cwd=tmp_path, env=unbuffered, capture_output=True, check=True).stdout
    assert run([*command[3:4], str(tmp_path / "a.ply"), "-o", str(tmp_path / "b.ply"), *command[-2:]]) == 0
    assert whole == (tmp_path / "b.ply").read_bytes()
    read_end, write_end = os.pipe()
    os.close(read_end)
    gone = subprocess.run(command, cwd=tmp_path, env=unbuffered, stdout=write_end, stderr=subprocess.PIPE)
    os.close(write_end)
    assert gone.returncode == 5
    assert gone.stderr == b"cascadenorm: the stream was closed by its reader before all was written\n"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no FIFOs here")
@pytest.mark.parametrize("command", ["denoise", "inspect", "fill-holes"])
def test_meshes_come_from_named_pipes(tmp_path, command):
    """As process substitution names them: `cascadenorm denoise <(…)`; the pipe is read once."""
    pipe, out = tmp_path / "pipe", tmp_path / "out.ply"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(PLY_TEXT,), daemon=True)
    writer.start()
    method = ["--method", "laplacian"] if command == "denoise" else []
    assert run([command, str(pipe), *([] if command == "inspect" else ["-o", str(out)]), *method]) == 0
    writer.join()
    if command != "inspect":
        assert len(cn.read(out).mesh.faces) >= 2


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no FIFOs here")
def test_a_pipe_has_no_place_for_an_output_beside_it(tmp_path, capsys):
    os.mkfifo(tmp_path / "pipe")
    assert run(["denoise", str(tmp_path / "pipe")]) == 5
    assert "is a pipe or a device, which has no folder for the output: give an output" in capsys.readouterr().err
