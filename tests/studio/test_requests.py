"""Requests about the open mesh, made in this process."""

import json
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
from shapes import icosphere, noisy

from cascadenorm.errors import OutputError, ReadError
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


@pytest.mark.parametrize("name", ["rough.ply", "link.ply"])
def test_the_opened_file_is_not_replaced(opened, name):
    Path("link.ply").symlink_to("rough.ply")
    before = Path("rough.ply").read_bytes()
    for kind, further in (("save", {"force": True}), ("recipe", {})):
        with pytest.raises(OutputError, match=rf"{name} is the opened file.*: choose another name") as refused:
            asked(opened, kind, settings=SETTINGS, target=name, **further)
        assert not refused.value.existing  # the page offers no replacement
    assert Path("rough.ply").read_bytes() == before and Path("link.ply").is_symlink()
    assert asked(opened, "download", settings=SETTINGS, name="rough.ply")["files"] == ["rough.ply"]


def test_buffers_of_the_opened_file_are_not_replaced_and_those_of_others_are_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_mesh(Path("opened.gltf"), ROUGH)
    document = json.loads(Path("opened.gltf").read_text("utf-8"))
    (buffer,) = document["buffers"]
    Path("other.bin").write_bytes(b64decode(buffer["uri"].partition(",")[2]))
    Path("opened.gltf").write_text(json.dumps({**document, "buffers": [{**buffer, "uri": "other.bin"}]}), "utf-8")
    requests = Requests()
    asked(requests, "open", path=str(tmp_path / "opened.gltf"), name="opened.gltf")
    with pytest.raises(OutputError, match=r"other\.bin is the opened file, or a part of it"):
        asked(requests, "save", settings=SETTINGS, target="other.gltf", force=True)
    Path("out.bin").write_bytes(b"precious")
    with pytest.raises(OutputError, match=r"out\.bin exists already") as refused:
        asked(requests, "save", settings=SETTINGS, target="out.gltf", force=False)
    assert refused.value.existing == ["out.bin"]
    asked(requests, "save", settings=SETTINGS, target="out.gltf", force=True)
    assert Path("out.bin").read_bytes() != b"precious"


def test_a_new_process_opens_the_same_content_or_says_why_not(opened, tmp_path):
    where = {"path": str(tmp_path / "rough.ply"), "name": "rough.ply"}
    digest = asked(opened, "open", **where)["digest"]
    again = Requests()
    asked(again, "reopen", **where, digest=digest)
    assert asked(again, "recipe", settings=SETTINGS, target="out.ply")["command"]
    Path("rough.ply").unlink()
    refused(where, digest, "does not exist")
    save_mesh(Path("rough.ply"), icosphere(2))
    refused(where, digest, "rough.ply has changed since it was opened: start the studio again")


def refused(where, digest, reason):
    """A new process cannot open the file, and says so with each request about it."""
    requests = Requests()
    with pytest.raises(ReadError, match=reason):
        asked(requests, "reopen", **where, digest=digest)
    with pytest.raises(ReadError, match=reason):
        asked(requests, "recipe", settings=SETTINGS, target="out.ply")
