"""Requests about the open mesh, made in this process."""

from pathlib import Path

import numpy as np
import pytest
from shapes import icosphere, noisy

from cascadenorm.errors import OutputError
from cascadenorm.io import atomic
from cascadenorm.io.interop import save_mesh
from cascadenorm.studio.requests import Requests

ROUGH = noisy(icosphere(2), 0.2)
SETTINGS = {"method": "laplacian", "parameters": {}, "controls": {}}


def asked(requests, kind, **given):
    return requests.done(kind, given, lambda fraction: None, lambda scene: None)


@pytest.fixture
def opened(tmp_path, monkeypatch):
    """Requests about rough.ply in the working folder."""
    monkeypatch.chdir(tmp_path)
    save_mesh(Path("rough.ply"), ROUGH)
    requests = Requests()
    asked(requests, "open", path=str(tmp_path / "rough.ply"), name="rough.ply")
    return requests


@pytest.mark.parametrize("name", ["out.ply", "out.stl"])
def test_a_result_and_its_paint_are_written_together_or_not_at_all(opened, monkeypatch, name):
    codes = np.zeros(len(ROUGH.vertices), np.uint8)
    codes[:10] = 255
    asked(opened, "paint", codes=codes.tobytes())
    stage = atomic._stage

    def full(target, *others, **named):
        if target.suffix == ".npy":
            raise OSError("no space left on device")
        stage(target, *others, **named)

    with monkeypatch.context() as patched:
        patched.setattr(atomic, "_stage", full)
        with pytest.raises(OutputError, match=r"out_fixed\.npy cannot be written: no space left"):
            asked(opened, "save", settings=SETTINGS, target=name, force=False)
    assert [path.name for path in Path().iterdir()] == ["rough.ply"]
    done = asked(opened, "save", settings=SETTINGS, target=name, force=False)
    assert [Path(path).name for path in done["files"]] == [name, "out_fixed.npy"]
