"""Numbers in XML are replaced by any others."""

import numpy as np
import pytest
from xml_files import FACES, TETRAHEDRON

from cascadenorm.io.content import Content
from cascadenorm.io.xml.collada import ColladaFile
from cascadenorm.io.xml.threemf import ThreemfFile
from cascadenorm.mesh.polygons import Polygons


@pytest.mark.parametrize("kind", [ColladaFile, ThreemfFile])
@pytest.mark.parametrize("number", [np.float32, np.float64])
def test_any_vertices_are_stored(kind, number):
    rng = np.random.default_rng(0)
    values = (rng.normal(size=(4, 3)) * 10.0 ** rng.integers(-20, 20, (4, 3))).astype(number)
    content = Content(np.array(TETRAHEDRON, number), Polygons.from_rows(np.array(FACES)))
    file = kind(b"".join(kind.encode(content)[0]))
    file = kind(b"".join(file.with_vertices(values.astype(file.positions.dtype)).pieces()))
    assert np.array_equal(file.positions, values.astype(np.float32))
    wide = kind(b"".join(kind.encode(Content(values, content.polygons))[0]))
    assert np.array_equal(wide.positions, values)
