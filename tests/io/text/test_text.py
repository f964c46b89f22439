"""Single numbers of a text are read and replaced to their last digit, and all around them stays."""

import re
import tracemalloc

import numpy as np
import pytest
from sample_files import OFF_TETRAHEDRON, PLY_TEXT, SAMPLES, read, written
from shapes import grid

from cascadenorm.io.content import Content
from cascadenorm.io.obj import ObjFile
from cascadenorm.io.off import OffFile
from cascadenorm.mesh import MeshError
from cascadenorm.mesh.polygons import Polygons


@pytest.mark.parametrize("name", ["ply text", "obj", "stl text", "off"])
def test_text_around_moved_numbers_stays(name):
    file = read(SAMPLES[name])
    vertices = file.mesh.vertices.copy()
    vertices[1] += 0.25
    before, after = SAMPLES[name].split(b"\n"), written(file.with_vertices(vertices)).split(b"\n")
    assert len(before) == len(after)
    for old, new in zip(before, after, strict=True):
        number = rb"(?<!\S)[-+]?[\d.]+(e[-+]?\d+)?(?!\S)"
        assert re.sub(number, b"#", old) == re.sub(number, b"#", new)
        if not old.lstrip().startswith((b"v", b"facet", b"1")):  # positions, normals
            assert old == new


def test_text_keeps_the_digits_of_far_coordinates():
    file = read(PLY_TEXT.replace(b"1.000 0 0", b"5000000.123456 0 0"))
    moved = read(written(file.with_vertices(file.mesh.vertices + 0.001)))
    assert moved.mesh.vertices[1, 0] == 5000000.123456 + 0.001


def test_text_beyond_single_precision_is_read_in_double():
    file = read(PLY_TEXT.replace(b"1.000 0 0", b"1e300 0 0"))
    assert file.mesh.vertices[1, 0] == 1e300
    infinite = read(PLY_TEXT.replace(b"1.000 0 0", b"inf 0 0"))
    with pytest.raises(MeshError, match="1 of 5 vertices are not finite"):
        _ = infinite.mesh


@pytest.mark.parametrize("word", [b"nan(ind)", b"-nan(ind)", b"1.#QNAN", b"-1.#INF", b"1.#IND00"])
def test_numbers_that_c_spells_as_none_are_vertices_that_are_not_finite(word):
    with pytest.raises(MeshError, match="1 of 4 vertices are not finite"):
        _ = read(OFF_TETRAHEDRON.replace(b"1 0 0", word + b" 0 0", 1)).mesh


@pytest.mark.compiled
@pytest.mark.parametrize("kind", [ObjFile, OffFile, "text"])
def test_reading_a_text_takes_a_few_times_its_size(kind, monkeypatch):
    monkeypatch.setattr("cascadenorm.io.text.text.WORDS_AT_A_TIME", 1 << 12)
    sheet = grid(100, 100)
    content = Content(sheet.vertices / 7, Polygons.from_rows(sheet.faces.astype(np.int64)))
    if kind == "text":
        data = b"ply\nformat ascii 1.0\nelement vertex %d\n" % len(sheet.vertices)
        data += b"property double x\nproperty double y\nproperty double z\n"
        data += b"element face %d\nproperty list uchar int vertex_indices\nend_header\n" % len(sheet.faces)
        data += b"".join(OffFile.encode(content)[0]).split(b"\n", 2)[2]
    else:
        data = b"".join(kind.encode(content)[0])
    read(data)  # compiles, and imports
    peaks = []
    for _ in range(3):  # other threads of the process can only add to the peak
        tracemalloc.start()
        read(data)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert min(peaks) < 6 * len(data)
