"""Layers and archives of USD are read within their folder and their memory, and damaged ones are refused in words."""

import io as streams
import re
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from sample_files import read
from shapes import grid, icosphere
from usd_layers import SCENE, archive, stored, values

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run

pytest.importorskip("pxr")


def test_layers_and_textures_of_an_archive_stay(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    root = b"#usda 1.0\n(\n    subLayers = [@parts/roof.usda@]\n)\n"
    (tmp_path / "in.usdz").write_bytes(
        archive({"root.usda": root, "parts/roof.usda": SCENE.encode(), "paint.png": b"p"})
    )
    assert run(["denoise", "in.usdz", "-o", "out.usdz", "--method", "laplacian", "--boundary", "free"]) == 0
    source, found = zipfile.ZipFile("in.usdz"), zipfile.ZipFile("out.usdz")
    assert found.namelist() == source.namelist()
    for name in ("root.usda", "paint.png"):
        assert found.read(name) == source.read(name)
    assert all(entry.compress_type == 0 for entry in found.infolist())
    expected = cn.denoise(cn.read("in.usdz").mesh, method="laplacian").vertices
    points = values(found.read("parts/roof.usda"), "/root/roof", tmp_path)["points"]
    np.testing.assert_allclose(points, expected, atol=1e-6)
    assert cn.read("out.usdz").content().positions.shape == (12, 3)  # composed through the root


def test_large_grids_are_read_and_written(tmp_path):
    sheet = grid(30, 40)
    io.write(io.from_arrays(sheet.vertices, sheet.faces), tmp_path / "a.usdz")
    assert np.array_equal(cn.read(tmp_path / "a.usdz").mesh.faces, sheet.faces)
    with zipfile.ZipFile(tmp_path / "a.usdz") as entries:
        (entry,) = entries.infolist()
    assert entry.date_time[:3] == (1980, 1, 2)  # the bytes depend on the mesh only
    with (tmp_path / "a.usdz").open("rb") as file:
        file.seek(entry.header_offset + 26)
        name, extra = np.frombuffer(file.read(4), "<u2")
        assert (entry.header_offset + 30 + int(name) + int(extra)) % 64 == 0  # as USDZ demands


@pytest.mark.parametrize("path", ["../secret.usda", "/etc/secret.usda"])
def test_nothing_outside_the_file_is_read(path, tmp_path, monkeypatch):
    folder = tmp_path / "in"
    folder.mkdir()
    secret = tmp_path / "secret.usda"
    secret.write_text(SCENE)
    path = str(secret) if path.startswith("/") else path
    text = SCENE.replace("references = </root/roof>", f"references = @{path}@")
    (folder / "a.usda").write_text(text)
    file = cn.read(folder / "a.usda")
    assert len(file.content().positions) == 6
    assert f"the file {path!r} that it references" in file.content().left_out
    only = f'#usda 1.0\ndef "a" (references = @{path}@) {{}}\n'
    with pytest.raises(io.ReadError, match=f"there is no mesh in this usda file; it references {re.escape(path)}"):
        read(only.encode(), "usda")
    for name in ("../evil.usda", "/evil.usda"):
        with pytest.raises(io.ReadError, match="outside the archive"):
            read(archive({"a.usda": SCENE.encode(), name: b""}), "usdz")


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux only")
def test_damaged_values_of_binary_layers_are_refused_when_they_are_read(capfd):
    """OpenUSD would allocate and fill as many tokens as a damaged array declares."""
    data = stored(SCENE.encode(), "usdc")
    refused = 0
    for at in range(88, 108):  # the number of entries of the first array
        try:
            read(data[:at] + bytes([data[at] ^ 0x80]) + data[at + 1 :], "usdc")
        except io.ReadError:
            refused += 1
    assert refused
    assert capfd.readouterr().out == ""


def test_damaged_bytes_are_refused(capfd):
    """A message of OpenUSD may show bytes that are no text; sections of a binary layer may run past its end."""
    with pytest.raises(io.ReadError, match="OpenUSD cannot read this file: it is damaged"):
        read(SCENE.encode().replace(b"(1, 0, 1)", b"(1, 0, \xa2)"), "usda")
    data = stored(SCENE.encode(), "usdc")
    table = int.from_bytes(data[16:24], "little")
    for at in (16, table, table + 8 + 16, table + 8 + 24):
        damaged = data[:at] + (5 << 40).to_bytes(8, "little") + data[at + 8 :]
        with pytest.raises(io.ReadError, match="a section of it runs past its end"):
            read(damaged, "usdc")
    for end in (9, 30, len(data) // 2, len(data) - 1):
        with pytest.raises(io.ReadError, match="a section of it runs past its end"):
            read(data[:end], "usdc")
    for row in range(table + 8, len(data) - 31, 32):
        begin = int.from_bytes(data[row + 16 : row + 24], "little")
        for byte in (3, 4, 7):  # of the number of entries
            damaged = data[: begin + byte] + b"\x47" + data[begin + byte + 1 :]
            with pytest.raises(io.ReadError, match="a section of it declares more entries than it can hold"):
                read(damaged, "usdc")
    assert capfd.readouterr().out == ""


def test_a_layer_that_lists_prims_it_does_not_have_is_refused(tmp_path):
    """The number of children of the root is damaged; OpenUSD aborts if it is asked for what they refer to."""
    ball = io.from_arrays(icosphere(1).vertices.astype(np.float32), icosphere(1).faces)
    whole = streams.BytesIO()
    io.write(ball, whole, format="usdc")
    for at, byte in ((96, 7), (97, 8)):
        data = bytearray(whole.getvalue())
        data[at] = byte
        (tmp_path / f"{at}.usdc").write_bytes(data)
    code = "from cascadenorm.cli import run\nfor name in ('96.usdc', '97.usdc'): print(run(['inspect', name]))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "3\n3\n")
    for name, line in zip(("96.usdc", "97.usdc"), done.stderr.splitlines(), strict=True):
        assert name in line and "there is no mesh in this usdc file" in line


def test_messages_about_damaged_binary_layers_name_no_temporary_file():
    data = stored(SCENE.encode(), "usdc")
    said = set()
    for at in range(88, len(data), 9):
        try:
            read(data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :], "usdc")
        except io.ReadError as error:
            said.add(str(error))
    assert any("OpenUSD cannot read this file: Encountered: " in text for text in said)
    assert not [text for text in said if re.search(r"\d\.usd|: $", text)]


@pytest.mark.parametrize(
    "text", ['#usda 1.0\ndef Mesh "m" {\n int[] faceVertexCounts = [3', "#usda 9.0\n\n", "#usda 1.0\n("]
)
def test_messages_about_text_name_its_lines_and_no_temporary_file(text):
    with pytest.raises(io.ReadError, match=r"OpenUSD cannot read this file: line \d+, column \d+: ") as caught:
        read(text.encode(), "usda")
    assert "/" not in str(caught.value).partition(" in <")[0] and "::" not in str(caught.value)
