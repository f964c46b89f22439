"""OBJ files keep all lines but those of positions and normals, however they are spaced."""

import io as streams

import numpy as np
import pytest
from sample_files import MATERIALS, OBJ, TETRAHEDRON, read, written

from cascadenorm import io
from cascadenorm.cli import run
from cascadenorm.io.obj import textures


def test_obj_seam_moves_together():
    seam = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 4 6 5\n"
    file = read(seam)
    assert file.welds.tolist() == [0, 1, 2, 1, 2, 3]
    moved = file.with_vertices(file.mesh.vertices + np.arange(12).reshape(4, 3))
    assert np.array_equal(moved.positions[1], moved.positions[3])
    assert np.array_equal(moved.positions[2], moved.positions[4])


def test_obj_indices_and_continuations():
    file = read(OBJ)
    polygons = np.split(file.polygons.corners, file.polygons.indptr[1:-1])
    assert [polygon.tolist() for polygon in polygons] == [[0, 1, 2, 3], [0, 1, 4], [1, 2, 4]]


def test_what_obj_vertices_say_beyond_colours_is_named_when_it_is_left_out():
    faces = b"f 1 2 3\n"
    for rows, named in (
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", False),
        (b"v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\n", False),
        (b"v 0 0 0 2\nv 1 0 0 2\nv 0 1 0 2\n", True),
        (b"v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\n", True),
    ):
        left_out = read(rows + faces).content().left_out
        assert any("further numbers of vertices" in what for what in left_out) == named


@pytest.mark.parametrize("change", [(b"\nv ", b"\n\tv\t"), (b"\nv ", b"\n  V "), (b"\n", b"\r")])
def test_an_obj_is_known_however_it_is_spaced(change):
    data = b"\n" + b"\n".join(b"v %d %d %d" % p for p in TETRAHEDRON) + b"\nf 1 3 2\n"
    assert read(data.replace(*change)).format == "obj"


def test_a_long_obj_is_known_without_its_name():
    data = b"# scan\n" + b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" * 10_000 + b"f 1 2 3\n"
    assert io.read(streams.BytesIO(data)).format == "obj"


@pytest.mark.parametrize("content", [b"<!DOCTYPE html>\n<p>v 1 2 3</p>\n", b"\x89PNG\r\n", b"hello\n", b"# v\n"])
def test_what_is_no_obj_is_refused(content):
    with pytest.raises(io.ReadError, match="not an OBJ file"):
        read(content, "obj")


def test_an_obj_whose_textured_faces_reference_missing_vertices_converts_isolated(tmp_path):
    """The corners of the other faces keep their texture coordinates and their normals."""
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\nvn 0 0 1\nvn 0 1 0\n"
    faces = b"f 2/4/2 9/1/2 3/2/2 1/1/2\nf 1/1/1 2/2/1 3/3/1\nf 2/2/1 4/4/1 3/3/1\n"
    (tmp_path / "a.obj").write_bytes(text + faces)
    assert run(["denoise", str(tmp_path / "a.obj"), "-o", str(tmp_path / "b.ply"), "--on-bad", "isolate"]) == 0
    made = io.read(tmp_path / "b.ply")
    assert made.polygons.corners.tolist() == [0, 1, 2, 1, 3, 2]
    assert made.content().vertex_values["s"].tolist() == [0, 1, 0, 1]
    file = read(text + faces).isolating()
    moved = written(file.with_vertices(file.mesh.vertices * 2)).split(b"\n")
    assert b"vn 0 1 0" in moved  # of the face that is left as it is


def test_textures_are_found_behind_their_options():
    assert textures(MATERIALS, "lib/a.mtl") == ["lib/../gloss.png", "lib/maps/bumps.png", "lib/maps/rust and dust.png"]
