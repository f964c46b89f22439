"""STL files are told apart from text and from other formats, and keep their attributes."""

import codecs
import io as streams

import numpy as np
import pytest
from sample_files import TETRAHEDRON, read, stl_binary, written

from cascadenorm import io
from cascadenorm.io.content import Content
from cascadenorm.io.files import FORMATS
from cascadenorm.mesh import MeshError
from cascadenorm.mesh.polygons import Polygons


def test_an_stl_without_facets_has_no_faces():
    with pytest.raises(MeshError, match="no faces"):
        _ = read(b"solid nothing\nendsolid nothing\n").mesh


@pytest.mark.parametrize("values", [[0, 1, 65535], [0, 1, 65536], [0, -1, 2], [0, 0.5, np.nan]])
def test_attributes_of_stl_are_named_when_they_do_not_fit(values):
    polygons = Polygons.from_rows(np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1)]))
    content = Content(np.array(TETRAHEDRON, np.float32), polygons, face_values={"attribute": np.array(values)})
    pieces, lost = FORMATS["stl"].encode(content)
    fits = values[2] == 65535
    assert ("face property 'attribute'" in lost) == (not fits)
    found = read(b"".join(pieces)).content().face_values
    assert found.get("attribute", np.zeros(0)).tolist() == (values if fits else [])


@pytest.mark.parametrize("start", [b"OFF ", b"ply\n", b"glTF", b'{"asset"', b"# vtk DataFile", b"###", b"solid "])
def test_a_binary_stl_may_begin_as_any_other_file(start):
    data = stl_binary()
    assert read(start.ljust(80) + data[80:]).format == "stl"


@pytest.mark.parametrize("rest", [b"", b"\0\0", b"x" * 51])
def test_a_binary_stl_with_facet_in_its_header_and_bytes_behind_is_binary(rest):
    data = b"solid made by a facet".ljust(80) + stl_binary()[80:] + rest
    file = read(data)
    assert len(file.polygons) == 4
    moved = written(file.with_vertices(file.mesh.vertices + 1))
    assert moved[:80] == data[:80] and moved.endswith(rest) and len(moved) == len(data)


def test_the_header_of_a_binary_stl_may_begin_as_it_likes():
    data = codecs.BOM_UTF8 + stl_binary()[3:]
    assert len(io.read(streams.BytesIO(data)).triangles) == len(io.read(streams.BytesIO(stl_binary())).triangles)
