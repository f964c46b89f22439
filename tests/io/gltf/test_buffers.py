"""Entries of a glTF document that are missing are named, and its buffers are read from its folder only."""

import json
import re

import numpy as np
import pytest
from gltfs import BALL, FAST, TEXT

import cascadenorm as cn
from cascadenorm import io
from cascadenorm.cli import run


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (("accessors", 0, "componentType"), "accessors[0] in the glTF document has no 'componentType'"),
        (("accessors", 2, "count"), "accessors[2] in the glTF document has no 'count'"),
        (("accessors", 1, "type"), "accessors[1] in the glTF document has no 'type'"),
        (("bufferViews", 1, "buffer"), "bufferViews[1] in the glTF document has no 'buffer'"),
        (("meshes", 0, "primitives"), "meshes[0] in the glTF document has no 'primitives'"),
        (
            ("meshes", 0, "primitives", 0, "attributes"),
            "meshes[0].primitives[0] in the glTF document has no 'attributes'",
        ),
        (("buffers", 1, "uri"), "buffer 1 of the glTF document has no data"),
    ],
)
def test_missing_keys_are_named_with_their_place(place, path, words):
    made = json.loads(TEXT)
    part = made
    for key in path[:-1]:
        part = part[key]
    del part[path[-1]]
    (place / "broken.gltf").write_text(json.dumps(made), encoding="utf-8")
    with pytest.raises(io.ReadError, match=re.escape(words)):
        cn.read("broken.gltf")


def test_lengths_of_buffers_are_not_needed(place):
    made = json.loads(TEXT)
    for part in (*made["bufferViews"], *made["buffers"]):
        del part["byteLength"]
    (place / "plain.gltf").write_text(json.dumps(made), encoding="utf-8")
    assert np.array_equal(cn.read("plain.gltf").positions, BALL.vertices.astype("<f4"))


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
