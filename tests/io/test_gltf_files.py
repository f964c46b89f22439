"""A glTF document, and the files of its buffers and pictures beside it."""

import json
import os
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from gltfs import BALL, FAST, TEXT, TWO_MESHES, beside_what_moves, document, seen_by_trimesh

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run


def names(folder) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_buffers_that_move_get_a_file_beside_the_output(place):
    before = {name: (place / name).read_bytes() for name in names(place)}
    assert run(["denoise", "ball.gltf", *FAST]) == 0
    assert names(place) == sorted([*before, "ball_denoised.gltf", "ball_denoised.bin"])
    assert all((place / name).read_bytes() == content for name, content in before.items())
    text = (place / "ball_denoised.gltf").read_text(encoding="utf-8")
    assert beside_what_moves(json.loads(text)) == beside_what_moves(json.loads(TEXT))
    assert [b["uri"] for b in json.loads(text)["buffers"]] == ["faces.bin", "ball_denoised.bin"]
    vertices = cn.denoise(BALL.moved(BALL.vertices.astype(np.float32)), method="laplacian").vertices
    assert np.array_equal(cn.read("ball_denoised.gltf").mesh.vertices, vertices.astype(np.float32))
    assert np.array_equal(seen_by_trimesh("ball_denoised.gltf"), vertices.astype(np.float32))


def test_unmoved_files_stay_as_they_are(place):
    assert run(["denoise", "ball.gltf", *FAST, "--strength", "0", "-o", "same.gltf"]) == 0
    assert (place / "same.gltf").read_bytes() == (place / "ball.gltf").read_bytes()
    assert not (place / "same.bin").exists()


@pytest.mark.parametrize("strength", ["0", "1"])
def test_another_folder_gets_all_that_is_needed(place, strength):
    (place / "out").mkdir()
    assert run(["denoise", "ball.gltf", *FAST, "-o", "out/b\u00e4ll 1.gltf", "--strength", strength]) == 0
    buffers = ["b\u00e4ll 1.bin"] if strength == "1" else ["the points.bin"]
    assert names(place / "out") == sorted(["b\u00e4ll 1.gltf", *buffers, "faces.bin", "maps/a colour.png"])
    for name in names(place):
        if name != "ball.gltf":
            (place / name).unlink() if not name.startswith("out/") else None
    assert len(cn.read("out/b\u00e4ll 1.gltf").mesh.faces) == 320


def test_what_lies_in_the_way_is_found_before_anything_is_computed(place, capsys, monkeypatch):
    monkeypatch.setattr("cascadenorm.api.api.run_with_controls", None)
    (place / "ball_denoised.bin").write_bytes(b"precious")
    (place / "out").mkdir()
    (place / "out" / "faces.bin").write_bytes(b"precious")
    before = names(place)
    for output in "ball_denoised.gltf", "out/ball.gltf":
        assert run(["denoise", "ball.gltf", *FAST, "-o", output]) == 5
        message = capsys.readouterr().err
        assert re.search(r"ball_denoised\.bin exists already|faces\.bin exists already", message)
    assert names(place) == before
    assert (place / "ball_denoised.bin").read_bytes() == (place / "out" / "faces.bin").read_bytes() == b"precious"


def test_equal_copies_are_in_nobodys_way(place):
    (place / "out").mkdir()
    (place / "out" / "faces.bin").write_bytes((place / "faces.bin").read_bytes())
    assert run(["denoise", "ball.gltf", *FAST, "-o", "out/a.gltf"]) == 0
    assert run(["denoise", "ball.gltf", *FAST, "-o", "out/b.gltf"]) == 0
    assert run(["denoise", "ball.gltf", *FAST, "-o", "out/b.gltf", "--force"]) == 0


def test_failing_write_takes_the_buffer_back(place, monkeypatch):
    monkeypatch.setattr(
        "os.link",
        lambda name, target: (
            (_ for _ in ()).throw(FileExistsError())
            if str(target).endswith("gltf")
            else (place / "ball_denoised.bin").write_bytes(b"new")
        ),
    )
    before = names(place)
    assert run(["denoise", "ball.gltf", *FAST]) == 5
    assert names(place) == before


@pytest.mark.parametrize("renames", range(6))
def test_a_document_never_names_the_buffer_of_another_one(place, monkeypatch, renames):
    """Whenever the work ends between two renames, the document and the buffer that it names belong together."""
    assert run(["denoise", "ball.gltf", *FAST]) == 0
    old, new = (cn.read(name).positions for name in ("ball_denoised.gltf", "ball.gltf"))
    new = cn.denoise(new, cn.read("ball.gltf").mesh.faces, method="laplacian", strength=2)
    before, done, replace = names(place), [], os.replace

    def some(name, target):
        if len(done) == renames:
            raise KeyboardInterrupt
        done.append(target)
        replace(name, target)

    monkeypatch.setattr("os.replace", some)
    code = run(["denoise", "ball.gltf", *FAST, "--strength", "2", "--force"])
    monkeypatch.undo()
    monkeypatch.chdir(place)
    found = cn.read("ball_denoised.gltf").positions
    assert code == (130 if renames < 4 else 0)
    assert found.tobytes() == (old if renames < 2 else new).tobytes()
    bounds = [a for a in document((place / "ball_denoised.gltf").read_bytes())["accessors"] if a["type"] == "VEC3"]
    assert any(np.array_equal(a["min"], found.min(axis=0)) for a in bounds)
    extra = [name for name in names(place) if name not in before]
    assert extra == [] if code == 0 else all(name.startswith(".ball_denoised.bin.") for name in extra)
    if code == 0:
        assert "ball_denoised.bin" in [
            b["uri"] for b in json.loads((place / "ball_denoised.gltf").read_text())["buffers"]
        ]


def test_missing_pictures_are_named_and_names_that_lead_out_refused(place, capsys):
    (place / "out").mkdir()
    (place / "maps" / "a colour.png").unlink()
    assert run(["denoise", "ball.gltf", *FAST, "-o", "out/ball.gltf", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["left_out"] == ["the file 'maps/a colour.png' that it references"]
    (place / "in").mkdir()
    (place / "in" / "up.gltf").write_text(TEXT.replace("faces.bin", "../faces.bin").replace("the%20", "../the%20"))
    assert run(["denoise", "in/up.gltf", *FAST]) == 3
    assert "buffer 0 is '../faces.bin', outside the folder of this file" in capsys.readouterr().err


def test_streams_hold_everything_or_are_refused(place, capsys, monkeypatch):
    with monkeypatch.context() as patched, open("out.gltf", "wb") as out:
        patched.setattr(sys, "stdout", SimpleNamespace(buffer=out, flush=lambda: None))
        assert run(["denoise", "ball.gltf", *FAST, "-o", "-"]) == 0
    assert run(["denoise", "ball.gltf", *FAST]) == 0
    assert np.array_equal(cn.read("out.gltf").positions, cn.read("ball_denoised.gltf").positions)
    assert document((place / "out.gltf").read_bytes())["buffers"][1]["uri"].startswith("data:")
    with open("ball.gltf", "rb") as stream, pytest.raises(io.ReadError, match="cannot be found from a stream"):
        io.read(stream)


@pytest.mark.parametrize("folder", ["", "elsewhere/"])
def test_every_buffer_that_the_output_names_is_written(two_meshes, folder):
    """Also those of meshes that stay where they are, and under names that no other buffer has."""
    source = cn.read("in.gltf")
    (two_meshes / folder / "q.bin").write_bytes((two_meshes / "q.bin").read_bytes())
    assert run(["denoise", "in.gltf", *FAST, "--only", "mesh=a", "-o", f"{folder}out.gltf"]) == 0
    moved = cn.read(f"{folder}out.gltf")
    count = len(BALL.vertices)
    assert np.array_equal(moved.mesh.faces, source.mesh.faces)
    assert np.array_equal(moved.positions[count:], source.positions[count:])
    assert (moved.positions[:count] != source.positions[:count]).any()
    uris = [buffer["uri"] for buffer in document((two_meshes / f"{folder}out.gltf").read_bytes())["buffers"]]
    assert uris == ["out_0.bin", "out_1.bin", "out.bin"]
    assert (two_meshes / folder / "out.bin").read_bytes() == BALL.faces.astype("<u2").tobytes()


def test_a_buffer_that_is_needed_and_missing_is_not_left_out(two_meshes, capsys):
    text = json.dumps({**TWO_MESHES, "buffers": [*TWO_MESHES["buffers"], {"uri": "animation.bin", "byteLength": 4}]})
    (two_meshes / "in.gltf").write_text(text)
    assert run(["denoise", "in.gltf", *FAST, "-o", "elsewhere/out.gltf"]) == 5
    assert "'animation.bin', which is missing" in capsys.readouterr().err
    assert names(two_meshes / "elsewhere") == []


@pytest.mark.parametrize("uri", ["../secret", "a/../../secret", "%2e%2e/secret", "..%5Csecret", "c:secret", "/secret"])
def test_nothing_outside_the_folder_is_read(two_meshes, uri, capsys):
    inside = two_meshes / "inside"
    inside.mkdir()
    (two_meshes / "secret").write_bytes((two_meshes / "p.bin").read_bytes())
    for name in "in.gltf", "q.bin", "out.bin":
        (two_meshes / name).rename(inside / name)
    (inside / "in.gltf").write_text((inside / "in.gltf").read_text().replace("p.bin", uri))
    assert run(["denoise", "inside/in.gltf", *FAST, "-o", "secret.glb"]) == 3
    assert re.search("outside the folder of this file|only relative file names", capsys.readouterr().err)


@pytest.mark.parametrize("uri", [".", "a" * 3000, "a\0b.png", "../p.png", "p.png/q.png"])
def test_images_that_cannot_be_are_named(two_meshes, uri, capsys):
    (two_meshes / "in.gltf").write_text(json.dumps({**TWO_MESHES, "images": [{"uri": uri}]}))
    assert run(["denoise", "in.gltf", *FAST, "-o", "elsewhere/out.gltf", "--json"]) == 0
    (left_out,) = json.loads(capsys.readouterr().out)["left_out"]
    assert left_out.startswith("the file '") and len(left_out) < 130
