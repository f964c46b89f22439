"""Files that trimesh reads are written in other formats."""

import re
import zipfile

import pytest
from sample_files import read, written
from shapes import icosphere

import cascadenorm as cn
from cascadenorm import io


def test_other_formats_go_through_trimesh(tmp_path):
    """A ZAE file is an archive with a COLLADA file in it; pycollada reads what is written as DAE."""
    pytest.importorskip("collada")
    ball = icosphere(1)
    io.write(io.from_arrays(ball.vertices, ball.faces), tmp_path / "ball.dae")
    with zipfile.ZipFile(tmp_path / "ball.zae", "w") as archive:
        archive.write(tmp_path / "ball.dae", "ball.dae")
    file = io.read(tmp_path / "ball.zae")
    assert written(file) == (tmp_path / "ball.zae").read_bytes()
    assert file.mesh.area == pytest.approx(ball.area)
    moved = file.with_vertices(file.mesh.vertices * 2)
    io.write(moved, tmp_path / "moved.ply")
    assert io.read(tmp_path / "moved.ply").mesh.area == pytest.approx(4 * ball.area)
    with pytest.raises(cn.OutputError, match="'zae' cannot be written"):
        io.write(moved, tmp_path / "moved.zae")
    with pytest.raises(io.ReadError, match="this zae file is a damaged archive"):
        read((tmp_path / "ball.zae").read_bytes()[:100], "zae")
    with zipfile.ZipFile(tmp_path / "empty.zae", "w") as archive:
        archive.writestr("empty.dae", re.sub(rb"(?s)<polylist.*</polylist>", b"", (tmp_path / "ball.dae").read_bytes()))
    with pytest.raises(io.ReadError, match="no triangle mesh"):
        io.read(tmp_path / "empty.zae")
