"""OFF files are read with any header and with values in any order."""

import numpy as np
import pytest
from sample_files import OFF_TETRAHEDRON, read, written


def test_off_without_its_keyword_and_with_counts_beside_it():
    rows = OFF_TETRAHEDRON.removeprefix(b"OFF\n4 4 6\n")
    for head in (b"OFF 4 4 6\n", b"OFF\n4 4 6\n", b"4 4 6\n", b"OFF4 4 0\n", b"# first\nOFF\n4 4\n"):
        assert read(head + rows, "off").mesh.volume == pytest.approx(1 / 6)


def test_off_may_be_lower_case_and_speak_of_what_it_is_not():
    for head in (b"off", b"OFF # not BINARY"):
        assert read(OFF_TETRAHEDRON.replace(b"OFF", head)).mesh.volume == pytest.approx(1 / 6)


@pytest.mark.parametrize(
    ("header", "values"),
    [
        (b"NCOFF", b"0 0 1 9 8 7 255"),  # as Open3D writes them
        (b"NCOFF", b"9 8 7 255 0 0 1"),  # as VCG does
        (b"CNOFF", b"0 0 1 9 8 7 255"),
        (b"NCSTOFF", b"9 8 7 255 0 0 1 .5 .5"),
        (b"STCN4OFF", b"1 0 0 1 9 8 7 255 .5 .5"),
    ],
)
def test_normals_and_colours_of_an_off_are_known_in_any_order(header, values):
    rows = [b"%d %d %d " % point + values for point in ((0, 0, 0), (1, 0, 0), (0, 1, 0))]
    file = read(header + b"\n3 1 0\n" + b"\n".join(rows) + b"\n3 0 1 2\n")
    channels = file.content().vertex_values
    assert [channels[name].tolist() for name in channels] == [[9] * 3, [8] * 3, [7] * 3, [255] * 3]
    turned = written(file.with_vertices(file.mesh.vertices @ np.array([(1, 0, 0), (0, 0, 1), (0, -1, 0)]).T))
    assert turned.split(b"\n")[2].split()[3:] == values.replace(b"0 0 1", b"0.0 1.0 0.0").split()
