"""Requests about the open mesh."""

import io
import json
import shlex
from base64 import b64decode
from pathlib import Path
from urllib.parse import unquote
from zipfile import ZipFile

import numpy as np
import pytest
from scans import LAPLACIAN, ROUGH, denoised
from shapes import icosphere
from studios import until

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.errors import OutputError, ReadError
from cascadenorm.io import atomic
from cascadenorm.io.interop import save_mesh
from cascadenorm.studio.requests import Requests

SETTINGS = {"method": "laplacian", "parameters": {}, "controls": {}}


def test_a_result_is_saved_with_all_that_the_file_holds_as_the_command_line_saves_it(studio, monkeypatch):
    with studio.told() as events:
        assert until(events, type="opened")["faces"] == len(ROUGH.faces)
        shown = denoised(studio, events, LAPLACIAN)
    assert shown["moved"] == len(ROUGH.vertices)
    done = studio.done("/api/save", {"settings": LAPLACIAN, "name": "out.ply"})
    assert (done["file"], done["left_out"]) == ("out.ply", [])
    saved = (studio.folder / "out.ply").read_bytes()
    (listed,) = done["files"]
    assert listed["path"] == str(studio.folder / "out.ply")
    assert studio.asked("GET", f"/api/saved/{listed['number']}") == (200, saved)
    assert studio.asked("GET", f"/api/saved/{listed['number']}", authorization=None)[0] == 401
    assert studio.asked("GET", f"/api/saved/{listed['number'] + 1}")[0] == 404
    (studio.folder / "out.ply").unlink()

    monkeypatch.chdir(studio.folder)
    command = shlex.split(done["command"])
    assert command[:3] == ["cascadenorm", "denoise", "scan.ply"] and "--strength" in command
    assert run(command[1:]) == 0
    assert (studio.folder / "out.ply").read_bytes() == saved
    (studio.folder / "out.ply").unlink()
    exec(done["python"], {})
    assert (studio.folder / "out.ply").read_bytes() == saved

    source, out = (cn.read(studio.folder / name).content().vertex_values for name in ("scan.ply", "out.ply"))
    for name in ("quality", "label"):
        np.testing.assert_array_equal(out[name], source[name])
    status, answer = studio.asked("POST", "/api/save", {"settings": LAPLACIAN, "name": "out.ply"})
    assert status == 400 and answer["remedy"] == ["force", True] and answer["existing"] == ["out.ply"]
    studio.done("/api/save", {"settings": LAPLACIAN, "name": "out.ply", "force": True})
    assert (studio.folder / "out.ply").read_bytes() == saved


@pytest.mark.parametrize("kind", ["save", "download", "recipe"])
def test_a_name_without_an_extension_is_refused(studio, kind):
    before = set(studio.folder.iterdir())
    status, answer = studio.asked("POST", f"/api/{kind}", {"settings": LAPLACIAN, "name": "out"})
    assert status == 400 and "out has no extension" in answer["error"] and "ply" in answer["error"]
    assert set(studio.folder.iterdir()) == before


def test_a_dropped_file_with_another_that_it_names_is_downloaded_with_it(drop_studio, tmp_path):
    rows = [f"v {x} {y} {z}" for x, y, z in ROUGH.vertices] + ["usemtl red"]
    rows += [f"f {a} {b} {c}" for a, b, c in ROUGH.faces + 1]
    (tmp_path / "part.obj").write_text("\n".join(["mtllib part.mtl", *rows]), encoding="utf-8")
    (tmp_path / "part.mtl").write_text("newmtl red\nKd 1 0 0\n", encoding="utf-8")
    assert drop_studio.drop(tmp_path / "part.mtl", tmp_path / "part.obj")[0] == 200
    status, packed = drop_studio.asked("POST", "/api/download", {"settings": LAPLACIAN, "name": "new.obj"})
    about = json.loads(unquote(drop_studio.headers["x-about"]))
    assert status == 200 and about["name"] == "new.zip"
    assert about["command"].startswith("cascadenorm denoise part.obj -o new.obj ")
    with ZipFile(io.BytesIO(packed)) as archive:
        assert sorted(archive.namelist()) == ["new.obj", "part.mtl"]
        (tmp_path / "new.obj").write_bytes(archive.read("new.obj"))
    cn.denoise_file(tmp_path / "part.obj", tmp_path / "same.obj", method="laplacian", strength=0.5,
                    parameters={"iterations": 2})  # fmt: skip
    assert (tmp_path / "new.obj").read_bytes() == (tmp_path / "same.obj").read_bytes()
    status, answer = drop_studio.asked("POST", "/api/save", {"settings": LAPLACIAN, "name": "new.obj"})
    assert status == 400 and "download the result" in answer["error"]


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
