"""Large meshes are shown by fewer faces between their own vertices."""

import numpy as np
import pytest
from report_contents import ROUGH

from cascadenorm.mesh import Mesh
from cascadenorm.reports.decimation import decimated


def test_small_meshes_are_shown_whole_and_large_ones_with_their_own_vertices():
    whole = decimated(ROUGH, most=len(ROUGH.faces))
    np.testing.assert_array_equal(whole.faces, ROUGH.faces)
    fewer = decimated(ROUGH, most=500)
    assert 250 < len(fewer.faces) <= 500
    drawn = Mesh(ROUGH.vertices[fewer.kept_vertices], fewer.faces)
    assert drawn.volume == pytest.approx(ROUGH.volume, rel=0.1)
    assert (np.diff(fewer.kept_faces) > 0).all()
    towards = (drawn.face_normals * ROUGH.face_normals[fewer.kept_faces]).sum(axis=1)
    assert (towards > 0).mean() > 0.9
