"""Streams that meshes are read from and written to take bytes, and pipes are read as files are."""

import io
import os
import re
import tempfile
import threading

import pytest
from sample_files import PLY_TEXT
from shapes import icosphere

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io import OutputError


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
