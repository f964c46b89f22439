"""Folders with glTF files in parts."""

import json

import numpy as np
import pytest
from gltfs import BALL, TEXT, TWO_MESHES


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a glTF file in four parts."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.gltf").write_text(TEXT, encoding="utf-8")
    (tmp_path / "faces.bin").write_bytes(BALL.faces.astype("<u2").tobytes())
    points = np.concatenate([BALL.vertices, BALL.vertices]).astype("<f4")
    (tmp_path / "the points.bin").write_bytes(points.tobytes())
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "a colour.png").write_bytes(b"picture")
    return tmp_path


@pytest.fixture
def two_meshes(tmp_path, monkeypatch):
    """A folder with a glTF file of two meshes, each with positions in a file of its own, and indices in a third."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.gltf").write_text(json.dumps(TWO_MESHES))
    for name, shift in ("p", 0), ("q", 5):
        (tmp_path / f"{name}.bin").write_bytes((BALL.vertices + shift).astype("<f4").tobytes())
    (tmp_path / "out.bin").write_bytes(BALL.faces.astype("<u2").tobytes())
    (tmp_path / "elsewhere").mkdir()
    return tmp_path
